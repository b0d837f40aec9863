"""What every controller owes whoever drives with it."""

import dataclasses
import functools
import math
import os
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from controllers import NAMES, make  # noqa: E402
from kinematics import PaperRobot, boxes, costmap_round, discs, drive, nowhere, path_through  # noqa: E402

from mbf_relay.control.state import ControlState, GoalTolerance, SpeedLimit  # noqa: E402
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D, angle_between  # noqa: E402
from mbf_relay.outcomes import ControlError, ControlOutcome  # noqa: E402
from mbf_relay.planning.path import Path  # noqa: E402
from mbf_relay.plugins import PluginError  # noqa: E402

START = Pose2D(0.0, 0.0, 0.0)
STRAIGHT = path_through((0, 0), (1.5, 0))
pytestmark = pytest.mark.parametrize("name", NAMES)


def state(pose=START, velocity=STOP, now=0.0, occupied=nowhere, costmap_from_path=IDENTITY):
    return ControlState(now, pose, velocity, costmap_round(pose, occupied), costmap_from_path, 0.1)


PATHS = {
    "straight": STRAIGHT,
    "bend": path_through((0, 0), (0.8, 0), (0.8, 0.8)),
    "behind": path_through((0, 0), (-0.8, 0)),
    "aside, turned at the end": path_through((0, 0), (0, 0.8), end_heading=-1.0),
    "a few centimetres": path_through((0, 0), (0.08, 0.05), end_heading=2.0),
    "only a turn": Path(np.array([[0.0, 0.0, 2.5]]), "odom"),
    "hairpin": path_through((0, 0), (0.9, 0), (0.9, 0.3), (0, 0.3)),
}


@functools.lru_cache(maxsize=None)
def driven(name, path, period):
    """Return what became of a drive where nothing stands, and the robot after it: one for all tests that look at one.
    """
    robot = PaperRobot(START)
    return drive(make(name), PATHS[path], START, seconds=40.0, period=period, robot=robot), robot


@pytest.mark.parametrize("path", sorted(PATHS))
@pytest.mark.parametrize("period", [0.05, 0.1, 0.2])
def test_it_arrives_in_place_and_heading_and_stands(name, path, period):
    ended, robot = driven(name, path, period)
    assert ended.reached, f"{ended.error}"
    goal = PATHS[path].goal
    assert robot.pose.distance_to(goal) <= 0.05 and abs(angle_between(robot.pose.theta, goal.theta)) <= 0.17
    assert robot.velocity.speed() <= 0.1
    ideal = PATHS[path].length / 0.22 + (2 * math.pi) / 2.75
    assert ended.seconds <= ideal + 4.0


@pytest.mark.parametrize("path", sorted(PATHS))
def test_commands_stay_within_limits_and_accelerations(name, path):
    ended, _ = driven(name, path, 0.1)
    commands = np.array(ended.commands)
    assert np.abs(commands[:, 0]).max(initial=0.0) <= 0.22 + 1e-9 and not commands[:, 1].any()
    assert np.abs(commands[:, 2]).max() <= 2.75 + 1e-9
    steps = np.abs(np.diff(np.vstack((np.zeros(3), commands)), axis=0))[~np.array(ended.failed)]
    assert steps[:, 0].max() <= 2.5 * 0.1 + 1e-9 and steps[:, 2].max() <= 3.2 * 0.1 + 1e-9


@pytest.mark.parametrize("told", [Twist2D(0.6, 0.0, 0.0), Twist2D(0.1, 0.0, 5.0), Twist2D(1.7, 0.0, -50.0)])
def test_a_robot_whose_odometry_counts_in_another_unit_is_not_driven_faster_and_faster(name, told):
    """Each command raised what odometry told, and that the next command: in millimetres, and in degrees a second."""
    controller = make(name)
    controller.set_path(STRAIGHT, True)
    try:
        command = controller.compute_velocity(dataclasses.replace(state(velocity=told), commanded=STOP))
    except ControlError:
        return
    assert abs(command.x) <= 0.22 + 1e-9 and abs(command.theta) <= 2.75 + 1e-9


def test_equal_input_gives_equal_output(name):
    one, two = (drive(make(name), PATHS["bend"], START, discs((0.4, 0.25, 0.05))).commands for _ in range(2))
    assert one == two


def test_another_frame_drives_the_same_way(name):
    transform = Pose2D(3.0, -1.0, 2.0)
    poses = transform.inverse().transform_poses(PATHS["bend"].poses)
    straight, turned = make(name), make(name)
    straight.set_path(PATHS["bend"], True)
    turned.set_path(Path(poses, "map"), True)
    for pose in (START, Pose2D(0.3, 0.02, 0.1), Pose2D(0.79, 0.2, 1.3)):
        assert turned.compute_velocity(state(pose, costmap_from_path=transform)) == pytest.approx(
            straight.compute_velocity(state(pose)), abs=1e-6)
        assert turned.is_goal_reached(state(pose, costmap_from_path=transform)) is False


def test_a_drive_that_was_called_off_leaves_nothing_to_brake_for(name):
    fresh, used = make(name), make(name)
    used.set_path(path_through((0, 0), (0, -0.8)), True)
    assert used.compute_velocity(state(now=0.0)).theta < 0.0
    seen = ControlState(0.1, START, STOP, costmap_round(START), IDENTITY, 0.1, commanded=STOP)
    for controller in (fresh, used):
        controller.set_path(path_through((0, 0), (0, 0.8)), True)
    assert used.compute_velocity(seen) == fresh.compute_velocity(seen) != STOP


def test_a_wall_across_the_way_is_not_touched_and_told(name):
    ended = drive(make(name), STRAIGHT, START, boxes((0.6, -2, 0.7, 2)), seconds=30.0)
    assert not ended.reached and ended.contacts == 0
    assert ended.error.outcome in (ControlOutcome.BLOCKED_PATH, ControlOutcome.NO_VALID_CMD)
    assert len(str(ended.error)) > 20


@pytest.mark.parametrize("cells", [0.5, 1.0, 2.0, 3.0])
def test_a_gap_hardly_wider_than_the_robot_is_passed_or_told_and_never_touched(name, cells):
    half = 0.5 * (0.21 + cells * 0.05)
    wall = boxes((0.8, half, 0.9, 3.0), (0.8, -3.0, 0.9, -half))
    ended = drive(make(name), path_through((0, 0), (1.8, 0)), Pose2D(0.0, 0.0, 0.0), wall, seconds=40.0)
    assert ended.contacts == 0
    if not ended.reached:
        assert cells < 2.0 and ended.error is not None, f"{ended.error} after {ended.seconds:.1f} s"
        assert ended.error.outcome in (ControlOutcome.NO_VALID_CMD, ControlOutcome.BLOCKED_PATH)


def test_an_obstacle_that_appears_close_ahead_is_not_touched(name):
    controller, robot, wall = make(name), PaperRobot(START, acceleration=2.5), boxes((0.9, -2, 1.0, 2))
    controller.set_path(STRAIGHT, True)
    for cycle in range(80):
        seen = wall if robot.pose.x > 0.9 - 0.041 - 0.1 else nowhere
        now = cycle * 0.1
        try:
            command = controller.compute_velocity(
                ControlState(now, robot.pose, robot.velocity, costmap_round(robot.pose, seen), IDENTITY, 0.1)
            )
        except ControlError:
            command = STOP
        robot.move(command, 0.1)
    assert robot.pose.x < 0.9 - 0.041


def test_a_goal_that_something_stands_on_is_blocked(name):
    ended = drive(make(name), STRAIGHT, START, discs((1.5, 0.0, 0.1)), seconds=30.0)
    assert not ended.reached and ended.contacts == 0 and ended.error.outcome is ControlOutcome.BLOCKED_GOAL
    assert "1.50" in str(ended.error)


def test_a_path_that_starts_a_metre_away_is_missed(name):
    controller = make(name)
    controller.set_path(path_through((0, 1.0), (1, 1.0)), True)
    with pytest.raises(ControlError, match="1.00 m") as missed:
        controller.compute_velocity(state())
    assert missed.value.outcome is ControlOutcome.MISSED_PATH


def test_a_path_lost_by_less_is_rejoined(name):
    assert drive(make(name), STRAIGHT, Pose2D(0.1, 0.3, -1.0)).reached


def test_wheels_that_do_not_turn_are_stuck(name):
    controller = make(name)
    controller.set_path(STRAIGHT, True)
    with pytest.raises(ControlError, match="wheels") as stuck:
        for cycle in range(60):
            controller.compute_velocity(state(now=cycle * 0.1))
    assert stuck.value.outcome is ControlOutcome.ROBOT_STUCK and cycle >= 20


def test_turning_on_the_spot_is_no_being_stuck(name):
    assert drive(
        make(name, max_vel_theta=0.4, min_vel_theta=0.0), Path(np.array([[0.0, 0.0, 3.0]]), "odom"), START
    ).reached


@pytest.mark.parametrize("poses, outcome", [
    (np.zeros((0, 3)), ControlOutcome.INVALID_PATH), (np.array([[0.0, math.nan, 0.0]]), ControlOutcome.INVALID_PATH),
])
def test_what_is_no_path_is_refused(name, poses, outcome):
    with pytest.raises(ControlError) as refused:
        make(name).set_path(Path(poses, "odom"), True)
    assert refused.value.outcome is outcome


def test_without_a_path_there_is_no_velocity_and_no_goal(name):
    controller = make(name)
    assert not controller.is_goal_reached(state())
    with pytest.raises(ControlError) as refused:
        controller.compute_velocity(state())
    assert refused.value.outcome is ControlOutcome.NOT_INITIALIZED


def test_a_pose_that_is_no_number_moves_nothing(name):
    controller = make(name)
    controller.set_path(STRAIGHT, True)
    with pytest.raises(ControlError):
        controller.compute_velocity(
            ControlState(0.0, Pose2D(math.nan, 0.0, 0.0), STOP, costmap_round(START), IDENTITY, 0.1)
        )


@pytest.mark.parametrize("changes, word", [
    ({"acc_lim_theta": 0.0}, "acc_lim_theta"), ({"acc_lim_x": 0.0}, "acc_lim_x"), ({"acc_lim_x": -1.0}, "acc_lim_x"),
    ({"max_vel_theta": float("nan")}, "max_vel_theta"), ({"max_vel_x": "fast"}, "max_vel_x"),
])
def test_limits_no_robot_could_have_are_named(name, changes, word):
    with pytest.raises(PluginError, match=word):
        make(name, **changes)


@pytest.mark.parametrize(
    "changes, word", [({"xy_goal_tolerance": 0.0}, "xy_goal_tolerance"), ({"acc_lim_x": 25.0}, "acc_lim_x")]
)
def test_a_limit_upstream_takes_to_its_range_is_taken_there_and_told(name, changes, word):
    assert not make(name).notes
    notes = make(name, **changes).notes
    assert len(notes) == 1 and word in notes[0]


def test_the_tolerance_of_the_action_holds(name):
    path, robot = path_through((0, 0), (1, 0)), PaperRobot(Pose2D(0.8, 0.1, 0.8))
    controller = make(name)
    controller.set_path(path, True)
    assert not controller.is_goal_reached(state(robot.pose))
    assert controller.is_goal_reached(state(robot.pose), GoalTolerance(0.3, 1.0))
    assert not controller.is_goal_reached(state(robot.pose), GoalTolerance(0.3, 0.5))
    assert not controller.is_goal_reached(state(robot.pose, Twist2D(0.2, 0.0, 0.0)), GoalTolerance(0.3, 1.0))


def test_a_tolerance_of_the_action_of_which_only_a_part_is_filled_in_lets_the_robot_arrive(name):
    """It circled on the spot for as long as it was let: no heading is ever the goal's exactly."""
    controller = make(name)
    controller.set_path(path_through((0, 0), (1, 0)), True)
    assert controller.is_goal_reached(state(Pose2D(0.8, 0.0, 0.01)), GoalTolerance(0.3, 0.0))
    assert controller.is_goal_reached(state(Pose2D(0.99, 0.0, 0.8)), GoalTolerance(0.0, 1.0))


def test_a_goal_somebody_stands_on_is_reached_as_far_off_as_its_tolerance_allows(name):
    """It was given up from a metre off, as soon as it was seen."""
    ended = drive(make(name, xy_goal_tolerance=0.4), STRAIGHT, START, discs((1.55, 0.0, 0.1)), seconds=30.0)
    assert ended.reached and ended.contacts == 0, ended.error


def test_a_robot_that_has_only_to_turn_at_a_goal_somebody_stands_on_does_so(name):
    """Its goal was given up, though it stood as near as the action had asked for."""
    controller, robot = make(name), PaperRobot(Pose2D(0.65, 0.0, 0.0))
    controller.set_path(path_through((0, 0), (1, 0), end_heading=1.5), True)
    for now in np.arange(0.0, 10.0, 0.1):
        seen = costmap_round(robot.pose, discs((1.0, 0.0, 0.1)))
        there = ControlState(now, robot.pose, robot.velocity, seen, IDENTITY, 0.1)
        if controller.is_goal_reached(there, GoalTolerance(0.5, 0.2)):
            return
        robot.move(controller.compute_velocity(there), 0.1)
    raise AssertionError(f"it stands at {tuple(robot.pose)}")


def test_a_new_path_to_the_same_goal_keeps_what_was_reached(name):
    path = path_through((0, 0), (1, 0), end_heading=3.0)
    controller = make(name, latch_xy_goal_tolerance=True)
    controller.set_path(path, True)
    at_goal = Pose2D(1.0, 0.0, 0.0)
    assert controller.compute_velocity(state(at_goal)).theta > 0.0
    controller.set_path(path, False)
    drifted = Pose2D(1.0, 0.09, 3.0)
    assert controller.is_goal_reached(state(drifted)), "latched: only the heading counts"
    controller.set_path(path, True)
    assert not controller.is_goal_reached(state(drifted))


def test_a_robot_that_stopped_short_of_where_it_was_expected_drives_on(name):
    controller, short = make(name, latch_xy_goal_tolerance=True), Pose2D(0.8, 0.0, 0.0)
    controller.set_path(path_through((0, 0), (1, 0)), True)
    expected = dataclasses.replace(state(Pose2D(1.0, 0.0, 0.0)), pose_now=short)
    controller.is_goal_reached(expected)
    controller.compute_velocity(expected)
    assert not controller.is_goal_reached(state(short)), "latched by where it was only expected"
    assert controller.compute_velocity(state(short)).x > 0.0


class SlipperyGoal(PaperRobot):
    """A robot that slides on by 6 cm when it brakes for the goal of `STRAIGHT`, as where commands come late."""

    slid = False

    def move(self, command, seconds, step=0.01):
        super().move(command, seconds, step)
        if not self.slid and abs(self.pose.x - 1.0) < 0.014:
            self.slid = True
            self.pose = self.pose.compose(Pose2D(0.06, 0.0, 0.0))


def test_a_robot_that_slid_out_of_tolerance_at_the_goal_does_not_stand_there_for_ever(name):
    robot = SlipperyGoal(START)
    ended = drive(make(name), path_through((0, 0), (1, 0)), START, robot=robot)
    assert robot.slid and ended.reached, f"it stands at {tuple(robot.pose)}"


def test_a_speed_limit_holds_for_its_distance(name):
    controller = make(name)
    controller.limit_speed(SpeedLimit(0.05, 0.3, 0.3))
    ended = drive(controller, path_through((0, 0), (1.5, 0)), START)
    slow = [c.x for p, c in zip(ended.poses, ended.commands) if p.x <= 0.3]
    assert (
        ended.reached and max(slow) <= 0.05 + 1e-9 and max(c.x for c in ended.commands) == pytest.approx(0.22, abs=0.01)
    )
    assert max(abs(c.theta) for p, c in zip(ended.poses, ended.commands) if p.x <= 0.3) <= 0.3 + 1e-9


def test_of_a_zone_s_limit_and_a_recovery_s_the_lower_one_holds(name):
    controller = make(name)
    controller.limit_speed(SpeedLimit(share=0.5), "zone")
    controller.limit_speed(SpeedLimit(0.05, 0.3, 0.3))
    ended = drive(controller, path_through((0, 0), (1.5, 0)), START)
    slow = [c.x for p, c in zip(ended.poses, ended.commands) if p.x <= 0.3]
    assert ended.reached and max(slow) <= 0.05 + 1e-9
    assert max(c.x for c in ended.commands) == pytest.approx(0.11, abs=0.01), "the zone's, where the recovery's is over"
    assert 0.5 * controller.top_speeds[0] == pytest.approx(0.11, abs=0.01), "of which recoveries have as much there"
    controller.limit_speed(SpeedLimit(), "zone")
    ended = drive(controller, path_through((0, 0), (1.5, 0)), START)
    assert max(c.x for c in ended.commands) == pytest.approx(0.22, abs=0.01)


def test_new_parameters_hold_from_the_next_cycle_on(name):
    controller = make(name)
    controller.set_path(STRAIGHT, True)
    for cycle in range(5):
        controller.compute_velocity(state(Pose2D(0.02 * cycle, 0.0, 0.0), Twist2D(0.2, 0.0, 0.0), cycle * 0.1))
    slower = "max_vel_trans" if "max_vel_trans" in controller.parameters.names() else "max_vel_x"
    controller.reconfigure(controller.parameters.replace(**{slower: 0.12}))
    assert controller.compute_velocity(state(Pose2D(0.12, 0.0, 0.0), Twist2D(0.2, 0.0, 0.0), 0.5)).x <= 0.12 + 1e-9


def test_a_robot_whose_top_speed_forwards_alone_is_lowered_drives_at_that_one(name):
    """By DWA it crept at 7 mm/s: measured by its speed backwards, all it could drive at was too slow to be worth it."""
    controller = make(name, max_vel_x=0.05, **({"desired_linear_vel": 0.05} if "pure_pursuit" in name else {}))
    ended = drive(controller, path_through((0, 0), (0.5, 0)), START)
    assert ended.reached and max(command.x for command in ended.commands) == pytest.approx(0.05, abs=0.005)


@pytest.mark.parametrize("path", ["aside, turned at the end", "a few centimetres"])
def test_a_robot_that_never_drives_slower_than_it_has_to_stands_at_its_goal(name, path):
    """It drove circles round it for good: to stand was less than min_vel_x."""
    ended = drive(make(name, min_vel_x=0.1), PATHS[path], START, seconds=30.0)
    assert ended.reached


@pytest.mark.parametrize("path, limit", [
    ("behind", "max_vel_trans"), ("straight", "max_vel_x"), ("behind", "max_vel_x"), ("behind", "max_vel_theta"),
])
def test_a_robot_whose_top_speed_is_set_to_0_stands_and_is_told_which(name, path, limit):
    """Some turned to and fro for 10 s, others stood for good; what they said was that it oscillates, or nothing."""
    if name.startswith("base_local_planner") and limit == "max_vel_theta":
        limit, turns = "max_vel_theta", dict(min_vel_theta=0.0, min_in_place_vel_theta=0.0)
    else:
        turns = {}
    controller = make(name, **{limit: 0.0}, **turns) if limit != "max_vel_trans" else make(name, max_vel_x=0.0, **{
        known: 0.0 for known in ("max_vel_trans", "min_vel_trans") if known in make(name).parameters.names()})
    ended = drive(controller, PATHS[path], START, seconds=10.0)
    assert ended.error is not None and ended.error.outcome is ControlOutcome.NO_VALID_CMD
    assert f"{limit} is 0" in ended.error.message and ended.seconds < 2.0
    assert all(command == STOP for command in ended.commands)


def test_a_robot_slow_to_accelerate_gets_going_where_cycles_are_shorter_than_odometry_s(name):
    controller, robot = make(name, acc_lim_x=0.1), PaperRobot(START, acceleration=0.1)
    controller.set_path(STRAIGHT, True)
    readings = [STOP]
    for cycle in range(150):
        if cycle % 2 == 0:
            readings.append(robot.velocity)
        seen = ControlState(
            cycle * 0.02, robot.pose, readings[-2], costmap_round(robot.pose), IDENTITY, 0.02
        )
        robot.move(controller.compute_velocity(seen), 0.02)
    assert robot.velocity.x > 0.18
