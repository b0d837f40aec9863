"""A robot that does not move though it is told to: what its owner is told to look at."""

from types import SimpleNamespace

import pytest

from mbf_relay.control.checkers import StuckChecker
from mbf_relay.geometry import IDENTITY, Twist2D
from mbf_relay.outcomes import ControlError


def told_of(command):
    """Return what is said of a robot that stands while it is told a velocity."""
    checker = StuckChecker()
    with pytest.raises(ControlError) as raised:
        for cycle in range(50):
            state = SimpleNamespace(now=0.1 * cycle, pose=IDENTITY, costmap=SimpleNamespace(width=0.4))
            checker.check(state, command, timeout=2.0)
    return raised.value.message


@pytest.mark.parametrize("command, is_turn", [
    (Twist2D(0.0, 0.0, 1.0), True), (Twist2D(0.3, 0.0, 0.5), False), (Twist2D(0.3, 0.0, 0.0), False)])
def test_the_owner_of_a_car_driven_by_turns_on_the_spot_is_told_what_drives_cars(command, is_turn):
    """All that was said was to look at wheels and motors, which were all right."""
    text = told_of(command)
    assert "wheels are free" in text and ("motion_model: Ackermann" in text) is is_turn
