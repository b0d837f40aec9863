"""Scripted situations with the outcome a user may expect, for every controller."""

import math
import os
import sys

import pytest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "..", "contract"))
from controllers import NAMES, make  # noqa: E402
from kinematics import (  # noqa: E402
    PaperRobot, boxes, costmap_round, drive, nowhere, path_through, sign_changes,
)

from mbf_relay.control.controller import ControlState  # noqa: E402
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D, angle_between  # noqa: E402
from mbf_relay.outcomes import ControlOutcome  # noqa: E402

START = Pose2D(0.0, 0.0, 0.0)
pytestmark = pytest.mark.parametrize("name", NAMES)


def test_an_obstacle_appears_ahead_and_goes_away(name):
    """It stands before the obstacle, and drives on when the way is free again."""
    robot, gone_at = PaperRobot(START), 8.0
    clock = {"now": 0.0}
    block = boxes((0.8, -1.0, 0.9, 1.0))

    def costmap(pose, occupied, now):
        clock["now"] = now
        there = robot.pose.x > 0.4 - 0.041 and now < gone_at
        return costmap_round(pose, block if there else nowhere, now=now)

    ended = drive(
        make(name), path_through((0, 0), (1.5, 0)), START, robot=robot, costmap=costmap, patience=10.0, seconds=30.0)
    before = [pose.x for pose, cycle in zip(ended.poses, range(len(ended.poses))) if cycle * 0.1 < gone_at]
    assert ended.reached and max(before) < 0.8 - 0.041


def test_a_goal_behind_is_turned_to_first(name):
    ended = drive(make(name), path_through((0, 0), (-1.0, 0)), START)
    assert ended.reached and sign_changes(c.theta for c in ended.commands) <= 1
    assert max(pose.distance_to(START) for pose in ended.poses[:10]) < 0.1
    assert ended.seconds < 1.0 / 0.22 + 3.5


def test_a_goal_in_a_dead_end_is_reached(name):
    walls = boxes((0.6, 0.2, 1.6, 0.3), (0.6, -0.3, 1.6, -0.2), (1.5, -0.3, 1.6, 0.3))
    ended = drive(make(name), path_through((0, 0), (1.35, 0)), START, walls)
    assert ended.reached and ended.contacts == 0


def test_a_corridor_of_0_35_m_is_left_the_way_it_was_entered(name):
    """Too narrow to turn in on a grid of 0.05 m: it turns where the circle is free, backs out, or says it cannot."""
    walls = boxes((-0.4, 0.175, 2.0, 0.3), (-0.4, -0.3, 2.0, -0.175))
    ended = drive(make(name), path_through((1.0, 0), (-1.2, 0)), Pose2D(1.0, 0.0, 0.0), walls, seconds=60.0, patience=3.0)
    assert ended.contacts == 0
    if not ended.reached:
        assert ended.error.outcome in (ControlOutcome.NO_VALID_CMD, ControlOutcome.BLOCKED_PATH, ControlOutcome.COLLISION)


@pytest.mark.parametrize("offset", [0.0, 0.012, 0.025])
def test_a_doorway_of_0_30_m_is_passed_or_told_and_never_touched(name, offset):
    door = boxes((0.6, 0.15 + offset, 0.65, 1.0), (0.6, -1.0, 0.65, -0.15 + offset))
    ended = drive(make(name), path_through((0, offset), (1.4, offset)), START, door, seconds=40.0, patience=3.0)
    assert ended.contacts == 0
    if not ended.reached:
        assert ended.error.outcome in (ControlOutcome.NO_VALID_CMD, ControlOutcome.BLOCKED_PATH)
    if offset == 0.0:
        assert ended.reached, "the posts end where cells do"


def test_a_straight_path_is_driven_straight_and_at_full_speed(name):
    ended = drive(make(name), path_through((0, 0), (3.0, 0)), START)
    assert sign_changes((c.theta for c in ended.commands), 0.02) == 0
    assert ended.seconds < 3.0 / 0.22 + 0.8
    assert ended.poses[-1].distance_to(Pose2D(3.0, 0.0, 0.0)) < 0.02


def test_replanning_from_where_the_robot_is_does_not_make_it_hunt(name):
    goal = (2.0, 0.6)

    def replan(now, pose):
        return path_through((pose.x, pose.y), goal, end_heading=0.0) if round(now * 10) % 2 == 0 else None

    ended = drive(make(name), path_through((0, 0), goal, end_heading=0.0), START, each_cycle=replan)
    assert ended.reached and sign_changes(c.theta for c in ended.commands) <= 2


def test_the_tutorials_minimum_turn_does_not_make_it_hunt_at_the_goal(name):
    """1.37 rad/s is a fifth of a turn per second and more than the tolerance per cycle."""
    for heading in (0.2, 0.5, 1.5, -2.5):
        ended = drive(make(name), path_through((0, 0), (0.5, 0), end_heading=heading), START)
        turns = [c.theta for p, c in zip(ended.poses, ended.commands) if p.distance_to(Pose2D(0.5, 0.0, 0.0)) < 0.05]
        assert ended.reached and sign_changes(turns) == 0
        assert abs(angle_between(ended.poses[-1].theta, heading)) <= 0.17


def test_slow_control_as_the_tutorials_five_hertz_is_safe(name):
    ended = drive(make(name), path_through((0, 0), (1.5, 0)), START, boxes((0.6, -2, 0.7, 2)), period=0.2)
    assert ended.contacts == 0 and not ended.reached


def test_what_is_hidden_behind_a_corner_bounds_the_speed(name):
    """The path turns left behind a block; with brakes this weak the robot must slow well before it."""
    path = path_through((0, 0), (1.0, 0), (1.0, 3.0))
    weak = dict(acc_lim_x=0.01, stop_time_buffer=0.0)
    speeds = []
    for occupied in (nowhere, boxes((0.1, 0.2, 0.85, 1.2))):
        controller = make(name, **weak)
        controller.set_path(path, True)
        state = ControlState(
            0.0, Pose2D(0.4, 0.0, 0.0), Twist2D(0.2, 0.0, 0.0), costmap_round(Pose2D(0.4, 0.0, 0.0), occupied), IDENTITY, 0.1)
        speeds.append(controller.look_around(state).speed)
    assert speeds[1] < 0.8 * speeds[0]
    visible = 0.6 + 0.25  # m of path before it disappears behind the block's corner, more or less
    assert speeds[1] == pytest.approx(math.sqrt(2 * 0.01 * visible), rel=0.25)
