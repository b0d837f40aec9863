"""A drive made by hand, its figures by hand, its picture and its page."""

import json
import math
import tempfile

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.maps import OccupancyMap
from mbf_relay.report import page, picture
from mbf_relay.report.drive_log import DriveLog


def straight_drive(offset=0.02, end_state="SUCCEEDED"):
    """Ten seconds along x at 0.2 m/s; odometry starts at the robot, localization is `offset` metres off in y."""
    log = DriveLog()
    log.map = OccupancyMap(np.zeros((40, 80), dtype=np.int8), 0.05, Pose2D(-1.0, -1.0, 0.0))
    log.add_correction(0.0, Pose2D(0.5, offset, 0.0))
    log.start_goal(0.0, "one", Pose2D(2.5, 0.0, 0.0))
    log.add_plan(0.0, np.array([[0.5, 0.0, 0.0], [2.5, 0.0, 0.0]]))
    for step in range(101):
        now = 0.1 * step
        log.add_truth(now, Pose2D(0.5 + 0.2 * now, 0.0, 0.0))
        log.add_odometry(now, Pose2D(0.2 * now, 0.0, 0.0))
        log.add_velocity(now, Twist2D(0.2, 0.0, 0.0))
        log.add_command(now, Twist2D(0.2, 0.0, 0.0))
    log.end_goal(10.0, "one", end_state, "Goal reached.")
    return log


def test_the_figures_of_a_straight_drive():
    figures = straight_drive().drive().summary()
    assert figures["success"] is True
    assert figures["goals_reached"] == figures["goals_asked"] == 1
    assert figures["path_length"] == pytest.approx(2.0)
    assert figures["sim_time"] == pytest.approx(10.0)
    assert figures["localization_error_mean"] == pytest.approx(0.02)
    assert figures["localization_error_max"] == pytest.approx(0.02)
    assert figures["heading_error_max"] == pytest.approx(0.0)
    json.dumps(figures)


def test_a_contact_or_a_missed_goal_is_no_success():
    log = straight_drive()
    log.add_contact(5.0, 1.0, 0.1, "wall")
    log.add_contact(5.1, 1.0, 0.1, "wall")
    log.add_contact(9.0, 1.0, 0.1, "wall")
    figures = log.drive().summary()
    assert figures["contacts"] == 2 and figures["success"] is False
    aborted = straight_drive(end_state="ABORTED").drive().summary()
    assert aborted["success"] is False and aborted["goals_reached"] == 0


def test_a_robot_wedged_between_two_things_has_touched_two():
    """Each was a new contact whenever the other had been told last: sixty in three seconds."""
    log = straight_drive()
    for step in range(30):
        for body in ("wall", "pillar_1"):
            log.add_contact(5.0 + 0.1 * step, 1.0, 0.1, body)
    contacts = log.drive().contacts
    assert [(contact.body, contact.stamp) for contact in contacts] == [("wall", 5.0), ("pillar_1", 5.0)]


def test_goals_that_never_came_count_as_missed():
    drive = straight_drive().drive()
    drive.goals_asked = 8
    assert drive.summary()["success"] is False


def test_headings_are_compared_the_short_way():
    log = DriveLog()
    log.add_correction(0.0, Pose2D(0.0, 0.0, 0.0))
    for now in (0.0, 1.0, 2.0):
        log.add_truth(now, Pose2D(0.0, 0.0, math.pi - 0.01))
        log.add_odometry(now, Pose2D(0.0, 0.0, -math.pi + 0.01))
    assert log.drive().localization_errors()[:, 2] == pytest.approx(0.02)


def test_a_correction_counts_from_its_time_on():
    log = DriveLog()
    for now, offset in ((0.0, 0.0), (1.0, 0.5)):
        log.add_correction(now, Pose2D(offset, 0.0, 0.0))
        log.add_odometry(now, Pose2D(0.0, 0.0, 0.0))
    assert list(log.drive().estimate[:, 1]) == [0.0, 0.5]


def test_a_clock_set_back_forgets_what_came_after():
    log = straight_drive()
    log.add_truth(3.0, Pose2D(9.0, 9.0, 0.0))
    truth = log.drive().truth
    assert truth[-1, 0] == 3.0 and np.all(np.diff(truth[:, 0]) >= 0.0)


def test_recoveries_belong_to_the_goal_that_runs():
    log = DriveLog()
    log.start_goal(0.0, "a", Pose2D(0, 0, 0))
    log.end_goal(1.0, "a", "ABORTED", "")
    log.start_goal(1.0, "b", Pose2D(0, 0, 0))
    log.add_recovery("rotate")
    assert [goal.recoveries for goal in log.drive().goals] == [[], ["rotate"]]


def dotted_in(axes):
    return [line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == ":"]


def test_a_robot_faster_than_the_burger_is_seen_to_its_top_speed():
    drive = straight_drive().drive()
    drive.measured[50, 1] = 0.8
    unlimited, limited = Figure().subplots(1, 2)
    picture.draw_speed(unlimited, drive, 1, "forward speed", "m/s")
    drive.speed_limits = (1.0, 2.0)
    picture.draw_speed(limited, drive, 1, "forward speed", "m/s")
    assert unlimited.get_ylim()[1] > 0.8 and limited.get_ylim()[1] > 1.0
    assert dotted_in(unlimited) == [] and dotted_in(limited) == [1.0, -1.0]


@pytest.mark.parametrize("log", [straight_drive(), DriveLog()], ids=["drive", "nothing recorded"])
def test_the_picture_is_a_picture_and_the_page_needs_no_other_file(tmp_path, log, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "full or not there"))
    drive = log.drive()
    picture.draw(drive, str(tmp_path / "report.png"))
    pixels = np.asarray(Image.open(str(tmp_path / "report.png")).convert("L"))
    assert pixels.shape[0] > 500 and pixels.std() > 5.0
    drive.parameters = {"amcl": {"min_particles": 500, "<odd>": "a & b"}}
    drive.versions = {"python": "3.x"}
    page.write(drive, str(tmp_path / "report.html"), b"a picture")
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "data:image/png;base64," in text and "http" not in text and "src='/" not in text
    assert "min_particles" in text and "&lt;odd&gt;" in text and picture.headline(drive) in text
