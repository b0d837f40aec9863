"""The parts an episode is made of: rates, frames, stages."""

import math
from pathlib import Path

import numpy as np
import pytest

from mbf_relay.control.state import GoalTolerance
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.lockstep.rate import Rate
from mbf_relay.lockstep.record import waits
from mbf_relay.lockstep.robot import LockstepRobot
from mbf_relay.lockstep.setup import without_map
from mbf_relay.lockstep.stages import Stages, TimedWorker
from mbf_relay.lockstep.tasks import circle, task_of
from mbf_relay.outcomes import StaleDataError, TransformError
from mbf_relay.simulation.worlds_file import world_of


@pytest.mark.parametrize("frequency, expected", [(200.0, 2000), (30.0, 300), (7.0, 70), (10.0, 100), (1.0 / 3.0, 4)])
def test_a_rate_keeps_its_average_exactly(frequency, expected):
    rate = Rate(frequency, 0.005)
    due = [step for step in range(2000) if rate.take_turn(step)]
    assert len(due) == expected
    for n, step in enumerate(due):
        assert -1e-9 <= step * 0.005 - n / frequency < 0.005 + 1e-9


def test_a_rate_beyond_the_clock_or_below_zero_is_refused():
    with pytest.raises(ValueError, match="allows 200 Hz"):
        Rate(201.0, 0.005)
    with pytest.raises(ValueError, match="above 0"):
        Rate(0.0, 0.005)


def robot():
    sent = []
    return LockstepRobot(sent.append, "map", "odom", "base_footprint"), sent


def test_frames_chain():
    made, _ = robot()
    made.add_odometry(1.0, Pose2D(1.0, 0.0, math.pi / 2), Twist2D(0.1, 0.0, 0.0))
    made.map_from_odom = Pose2D(10.0, 5.0, 0.0)
    assert made.pose_in("odom") == pytest.approx((1.0, 0.0, math.pi / 2))
    assert made.pose_in("map") == pytest.approx((11.0, 5.0, math.pi / 2))
    assert made.transform("odom", "map").compose(Pose2D(11.0, 5.0, 0.0)) == pytest.approx((1.0, 0.0, 0.0))
    assert made.transform("map", "map") == (0.0, 0.0, 0.0)
    assert made.velocity() == (0.1, 0.0, 0.0)


def test_what_is_not_there_yet_is_an_error():
    made, _ = robot()
    with pytest.raises(TransformError, match="no odometry"):
        made.pose_in("odom")
    with pytest.raises(StaleDataError):
        made.velocity()
    made.add_odometry(1.0, Pose2D(0.0, 0.0, 0.0), Twist2D(0.0, 0.0, 0.0))
    with pytest.raises(TransformError, match="not related"):
        made.pose_in("map")
    with pytest.raises(TransformError, match="no frame 'base_lunk'"):
        made.transform("odom", "base_lunk")


def test_odometry_between_two_measurements_turns_the_short_way():
    made, _ = robot()
    made.add_odometry(1.0, Pose2D(0.0, 0.0, 3.0), Twist2D(0.0, 0.0, 0.0))
    made.add_odometry(2.0, Pose2D(1.0, 2.0, -3.0), Twist2D(0.0, 0.0, 0.0))
    halfway = made.odometry_at(1.5)
    assert halfway[:2] == pytest.approx((0.5, 1.0))
    assert abs(halfway.theta) == pytest.approx(math.pi)
    assert made.odometry_at(2.0) == (1.0, 2.0, -3.0)
    assert made.odometry_at(2.5) == (1.0, 2.0, -3.0)
    with pytest.raises(TransformError, match="0.500 s"):
        made.odometry_at(0.5)


def test_velocities_go_to_the_wheels():
    made, sent = robot()
    made.command(Twist2D(0.1, 0.0, 0.2))
    assert sent == [(0.1, 0.0, 0.2)]


def test_inner_stages_are_counted_once():
    times = iter([0.0, 1.0, 3.0, 6.0])
    stages = Stages(lambda: next(times))
    with stages.stage("navigation"):
        assert TimedWorker(stages).start(lambda: 2, "planners").result() == 2
    assert stages.seconds == {"navigation": 4.0, "planning": 2.0}


def test_without_a_clock_nothing_is_measured():
    stages = Stages(None)
    with stages.stage("any"):
        pass
    assert stages.seconds == {}


def test_a_wait_at_a_goal_begins_when_the_robot_came_within_tolerance_for_good():
    times = np.arange(8.0)
    poses = np.zeros((8, 3))
    poses[:, 0] = (1.0, 0.04, 0.06, 0.04, 0.03, 0.03, 1.0, 2.0)
    poses[:, 2] = (0.0, 0.0, 0.0, 0.3, 2.0 * math.pi, 0.1, 0.0, 0.0)
    goals = (Pose2D(0.0, 0.0, 0.0), Pose2D(2.0, 0.0, 0.0), Pose2D(9.0, 0.0, 0.0))
    assert waits(times, poses, goals, (5.5, 7.0), GoalTolerance(0.05, 0.17)) == pytest.approx((1.5, 0.0))
    assert waits(times, poses, goals, (2.0,), GoalTolerance(0.05, 0.17)) == (0.0,), "it had left again"


@pytest.mark.parametrize("local, expected", [(0.025, 0.025), (0.1, 0.05)])
def test_a_robot_without_a_map_plans_on_cells_as_fine_as_it_drives_on(local, expected):
    server = {"global_costmap": {}, "local_costmap": {"resolution": local}}
    assert without_map(server, circle())["global_costmap"]["resolution"] == expected
    server["global_costmap"]["resolution"] = 0.2
    assert without_map(server, circle())["global_costmap"]["resolution"] == 0.2, "what somebody says holds"


@pytest.mark.parametrize("length, reach", [(2.0, 3.0), (12.0, 6.0), (500.0, 30.0)])
def test_a_robot_without_a_map_may_be_led_far_aside_by_a_long_wall(length, reach):
    """It planned 3 m round start and goal: a way that left that was none, and one it lost itself on was OUT_OF_MAP."""
    wall = {"name": "wall", "start": [0, 0, 0], "goal": [2, 0, 0], "boxes": [[1.0, 0.0, 0.0, 0.1, length, 0.5]]}
    group = without_map({"global_costmap": {}}, task_of(world_of(Path("worlds.json"), 0, wall)))["global_costmap"]
    assert group["origin_y"] == pytest.approx(-reach) and group["height"] == pytest.approx(2.0 * reach)
    assert group["origin_x"] == pytest.approx(-3.0) and group["width"] == pytest.approx(8.0)
