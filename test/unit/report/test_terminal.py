"""The lines of a drive, on a terminal and in a log."""

import io

import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.report.drive import ContactRecord, Drive, GoalRecord
from mbf_relay.report.terminal import Terminal

REACHED = GoalRecord(Pose2D(1.0, 0.0, 0.0), 10.0, 14.5, "SUCCEEDED", "Goal reached.")
FAILED = GoalRecord(Pose2D(1.0, 0.0, 0.0), 10.0, 12.0, "ABORTED", "no plan", ["rotate"])


class Screen(io.StringIO):
    def isatty(self):
        return True


def test_a_log_gets_one_plain_line_for_each_goal_that_ended():
    log = io.StringIO()
    terminal = Terminal(log, 8, {})
    terminal.progress(1, 2.0, 0.2, 3.0, 0)
    terminal.ended(1, REACHED)
    terminal.ended(2, FAILED)
    assert log.getvalue().splitlines() == [
        "goal 1 of 8  reached in 4.5 s",
        "goal 2 of 8  aborted: no plan in 2.0 s, after rotate",
    ]


def test_a_terminal_shows_a_live_line_that_the_next_one_replaces():
    screen = Screen()
    terminal = Terminal(screen, 8, {"TERM": "xterm"})
    terminal.progress(1, None, 0.0, 0.1, 0)
    terminal.progress(1, 2.0, 0.2, 3.0, 1)
    shown = screen.getvalue()
    assert "\n" not in shown and shown.count("\r") == 2
    for words in ("goal 1 of 8", "planning", "2.00 m left", "0.20 m/s", "3.0 s", "1 recoveries"):
        assert words in shown
    terminal.ended(1, REACHED)
    assert screen.getvalue().endswith("\033[32mreached\033[0m in 4.5 s\n")


@pytest.mark.parametrize("environment", [{"NO_COLOR": "1", "TERM": "xterm"}, {"TERM": "dumb"}])
def test_colours_stay_off_where_they_are_not_wanted(environment):
    screen = Screen()
    terminal = Terminal(screen, None, environment)
    terminal.progress(1, 2.0, 0.2, 3.0, 0)
    terminal.ended(1, FAILED)
    assert "\033[3" not in screen.getvalue() and "\033[2m" not in screen.getvalue()


def test_the_table_tells_a_clean_drive_from_another():
    drive = Drive(goals=[REACHED], goals_asked=1, wall_time=2.0)
    log = io.StringIO()
    Terminal(log, 1, {}).table(drive)
    assert (
        "1 of 1" in log.getvalue() and log.getvalue().rstrip().endswith("clean drive") and "not a" not in log.getvalue()
    )
    drive.contacts.append(ContactRecord(11.0, 0.0, 0.0, "wall"))
    log = io.StringIO()
    Terminal(log, 1, {}).table(drive)
    assert log.getvalue().rstrip().endswith("not a clean drive")
