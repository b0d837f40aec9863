"""How late commands reach the wheels is told from how the robot turns."""

import math

import numpy as np
import pytest

from mbf_relay.navigation.command_delay import CommandDelay

PERIOD = 0.1


def late_by(delay, turns, lag=0.0):
    """Return what is told of a robot that does what it was told `delay` seconds before, its wheels slow by `lag` (s).
    """
    watched, heading, rate, wait = CommandDelay(), 3.0, 0.0, round(delay / 0.01)
    told = [0.0] * wait
    for cycle, turn in enumerate(turns):
        watched.note(PERIOD * cycle, turn, math.remainder(heading, math.tau))
        for _ in range(round(PERIOD / 0.01)):
            told.append(turn)
            change = told.pop(0) - rate
            rate += change if lag == 0.0 else change * 0.01 / lag
            heading += 0.01 * rate
    return watched.late_by()


SWINGS = np.sin(np.arange(80) * PERIOD * 2.0)


@pytest.mark.parametrize("delay", [0.3, 0.5, 0.8])
def test_a_robot_that_swings_because_it_hears_late_says_by_how_much(delay):
    assert late_by(delay, SWINGS) == pytest.approx(delay, abs=0.1)


@pytest.mark.parametrize("turns, delay, lag", [
    (SWINGS, 0.0, 0.0), (SWINGS, 0.1, 0.1), (0.001 * SWINGS, 0.5, 0.0), (SWINGS[:20], 0.5, 0.0), ([], 0.0, 0.0),
])
def test_a_robot_that_turns_when_told_or_hardly_at_all_blames_no_delay(turns, delay, lag):
    assert late_by(delay, turns, lag) == 0.0


def test_a_robot_that_does_not_do_what_it_is_told_at_all_blames_no_delay():
    rng = np.random.default_rng(1)
    watched, heading = CommandDelay(), 0.0
    for cycle in range(100):
        heading += 0.1 * rng.normal()
        watched.note(PERIOD * cycle, rng.normal(), heading)
    assert watched.late_by() == 0.0
