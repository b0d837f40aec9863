"""A drive that another controller takes over while the robot moves."""

import pytest
import scripted
from scripted import FORWARD

from mbf_relay.geometry import STOP
from mbf_relay.navigation.goals import FollowGoal

PATH = scripted.straight_path()


@pytest.mark.parametrize("stop", [
    lambda bench: None, lambda bench: setattr(bench.robot, "paused", True)], ids=["its first call hangs", "paused"])
def test_a_robot_that_another_controller_takes_over_in_motion_does_not_drive_on_unattended(held_bench, stop):
    bench = held_bench
    bench.navigator.exe_path(FollowGoal(PATH, controller="C1"))
    bench.step()
    bench.step()
    assert bench.robot.sent[-1] == FORWARD
    bench.worker.delays = [None]
    bench.navigator.exe_path(FollowGoal(PATH, controller="C2"))
    stop(bench)
    for _ in range(6):
        bench.step()
    assert bench.robot.sent[-1] == STOP
