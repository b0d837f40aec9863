"""Nothing in a controller is made for one robot: the same situations, with robots of three sizes at three speeds.

Worlds, tolerances and the lengths users set by parameter scale with the robot; a fast robot accelerates and looks ahead
as one does that is to drive at its speed. What a controller has in itself must fit all of them.
"""

import functools
import itertools
import math
import os
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from controllers import NAMES, make  # noqa: E402
from kinematics import BURGER, PaperRobot, boxes, costmap_round, discs, drive, nowhere, path_through, touches  # noqa: E402
from tally import LONG  # noqa: E402

from mbf_relay.control.state import ControlState  # noqa: E402
from mbf_relay.geometry import IDENTITY, STOP, Pose2D, angle_between  # noqa: E402
from mbf_relay.outcomes import ControlError, ControlOutcome  # noqa: E402
from mbf_relay.planning.path import Path  # noqa: E402

START, PERIOD = Pose2D(0.0, 0.0, 0.0), 0.1
SIZES, SPEEDS = (0.2, 0.5, 1.2), (0.2, 1.0, 2.0)
MPPI_PAIRS = set(itertools.product(SIZES, SPEEDS) if LONG else zip(SIZES, SPEEDS))
"""MPPI takes some ten times the computing of the others: all its sizes at all speeds only under --long."""

pytestmark = pytest.mark.parametrize(
    "name, size, speed",
    [
        (name, size, speed)
        for name, size, speed in itertools.product(NAMES, SIZES, SPEEDS)
        if name != "mppi" or (size, speed) in MPPI_PAIRS
    ],
)


class Scaled:
    """A robot `size` metres wide that drives at `speed` (m/s), and a world scaled with it.

    Lengths of a world for a robot 0.2 m wide come in as they are for that; where a fast robot must be able to stop in
    it, in stopping distances.
    """

    def __init__(self, size, speed):
        self.scale = size / 0.21
        self.footprint = BURGER * self.scale
        self.speed, self.acceleration = speed, max(2.5, 2.0 * speed)
        self.stops = 2.0 * speed * PERIOD + speed * speed / (2.0 * self.acceleration)  # m
        self.stretch = self.scale * max(1.0, self.stops / (0.5 * self.scale))  # of ways, which a fast robot has long
        self.resolution = min(0.1, 0.05 * self.scale)
        self.seen = {}

    def controller(self, name, **changes):
        ahead = max(0.325 * self.scale, 0.5 * self.speed)
        turn = min(2.75, 1.5 * max(1.0, self.speed / self.scale))
        values = dict(
            max_vel_x=self.speed,
            min_vel_x=-self.speed,
            max_vel_trans=self.speed,
            min_vel_trans=0.5 * self.speed,
            max_vel_theta=turn,
            min_vel_theta=0.5 * turn,
            acc_lim_x=self.acceleration,
            xy_goal_tolerance=0.05 * self.scale,
            missed_path_distance=0.5 * self.scale,
            forward_point_distance=0.325 * self.scale,
            sim_time=max(1.0, 0.33 * self.scale / self.speed),
            oscillation_reset_dist=0.05 * self.scale,
            sim_granularity=0.025 * self.scale,
            desired_linear_vel=self.speed,
            lookahead_dist=ahead,
            regulated_linear_scaling_min_radius=0.3 * self.scale,
            cost_scaling_dist=0.15 * self.scale,
            regulated_linear_scaling_min_speed=0.3 * self.speed,
            min_approach_linear_velocity=0.1 * self.speed,
            scaling_speed=self.speed,
        )
        if name == "base_local_planner/TrajectoryPlannerROS":
            values.update(
                min_vel_x=0.5 * self.speed,
                escape_vel=-self.speed,
                min_vel_theta=-turn,
                min_in_place_vel_theta=0.5 * turn,
                heading_lookahead=0.325 * self.scale,
            )
        elif name == "mppi":  # by Nav2's names
            near = {"threshold_to_consider": 0.5 * self.scale}
            braking = {"threshold_to_consider": 0.5 * self.scale + self.stops}
            values.update(
                vx_max=self.speed,
                vx_min=-self.speed,
                wz_max=turn,
                ax_max=self.acceleration,
                vx_std=0.45 * self.speed,
                wz_std=0.25 * turn,
                model_dt=max(0.05, 0.5 * self.scale / self.speed / 56),
                prune_distance=max(1.5 * self.scale, 2.0 * self.speed),
                CostCritic={"near_goal_distance": 0.5 * self.scale},
                GoalCritic=braking,
                PathFollowCritic={**braking, "offset_from_furthest": 3},
                PathAlignCritic={**braking, "cost_weight": 20.0, "offset_from_furthest": 6},
                PathAngleCritic=near,
                PreferForwardCritic=near,
            )
        return make(name, **{**values, **changes})

    def costmap(self, pose, occupied=nowhere, now=0.0):
        """Return the costmap round a robot; one made for the same cells of the same world is returned again."""
        size = max(3.0 * self.scale, 2.0 * 1.5 * self.speed + 1.5 * self.scale)
        key = (occupied, *(math.floor((place - size / 2.0) / self.resolution) for place in pose[:2]))
        if key not in self.seen:
            self.seen[key] = costmap_round(
                pose, occupied, size, self.resolution, self.footprint, inflation=self.scale, decay=3.0 / self.scale)
        return self.seen[key]

    def path(self, *corners, end_heading=None):
        points = [(self.stretch * x, self.stretch * y) for x, y in corners]
        return path_through(*points, spacing=0.5 * self.resolution, end_heading=end_heading)

    def drive(self, controller, path, occupied=nowhere):
        self.seen.clear()
        robot = PaperRobot(START, 1.2 * self.acceleration)
        seconds = 20.0 + 5.0 * path.length / self.speed
        ended = drive(
            controller, path, START, occupied, seconds, PERIOD, robot, costmap=self.costmap, footprint=self.footprint)
        return ended, robot


@functools.lru_cache(maxsize=None)
def scaled(size, speed):
    return Scaled(size, speed)


@pytest.mark.parametrize("corners, heading", [
    (((0, 0), (1.5, 0)), None), (((0, 0), (0.8, 0), (0.8, 0.8)), None), (((0, 0), (-0.8, 0)), None),
    (((0, 0), (0, 0.8)), -1.0),
], ids=["straight", "bend", "behind", "aside"])
def test_it_arrives_and_stands(name, size, speed, corners, heading):
    world = scaled(size, speed)
    path = world.path(*corners, end_heading=heading)
    ended, robot = world.drive(world.controller(name), path)
    assert ended.reached, f"{ended.error} after {ended.seconds:.1f} s"
    assert robot.pose.distance_to(path.goal) <= 0.05 * world.scale + 1e-6
    assert abs(angle_between(robot.pose.theta, path.goal.theta)) <= 0.17
    assert ended.seconds <= 2.0 * path.length / speed + 15.0


def test_a_path_folded_back_beside_itself_is_driven_to_its_end(name, size, speed):
    """Near both ways, which are three tenths of its width apart, it stood before the bend."""
    world = scaled(size, speed)
    path = world.path((0, 0), (1.0, 0), (1.0, 0.06), (0.2, 0.06))
    ended, _ = world.drive(world.controller(name), path)
    assert ended.reached, f"{ended.error} after {ended.seconds:.1f} s"


def test_it_passes_a_gap_half_as_wide_again_as_the_robot(name, size, speed):
    world = scaled(size, speed)
    half, at = 0.16 * world.scale, 0.8 * world.stretch
    wall = boxes(
        (at, half, at + 0.1 * world.scale, 9.0 * world.scale), (at, -9.0 * world.scale, at + 0.1 * world.scale, -half)
    )
    ended, _ = world.drive(world.controller(name), world.path((0, 0), (1.8, 0)), wall)
    assert ended.reached and ended.contacts == 0, f"{ended.error} after {ended.seconds:.1f} s"


def test_a_wall_across_the_way_is_not_touched_and_told(name, size, speed):
    world = scaled(size, speed)
    at = 0.9 * world.stretch
    wall = boxes((at, -9.0 * world.scale, at + 0.2 * world.scale, 9.0 * world.scale))
    ended, _ = world.drive(world.controller(name), world.path((0, 0), (1.8, 0)), wall)
    assert not ended.reached and ended.contacts == 0
    assert ended.error.outcome in (ControlOutcome.BLOCKED_PATH, ControlOutcome.NO_VALID_CMD)


def test_a_goal_that_something_stands_on_is_blocked(name, size, speed):
    world = scaled(size, speed)
    goal = 1.5 * world.stretch
    ended, _ = world.drive(world.controller(name), world.path((0, 0), (1.5, 0)), discs((goal, 0.0, 0.1 * world.scale)))
    assert not ended.reached and ended.contacts == 0 and ended.error.outcome is ControlOutcome.BLOCKED_GOAL


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_told_to_turn_back_beside_a_wall_it_brakes_before_it_swings_into_it(name, size, speed, side):
    """A turn on the spot was free where the robot was, and turned it into the wall while it still rolled."""
    world = scaled(size, speed)
    world.seen.clear()
    controller = world.controller(name, **{"az_max" if name == "mppi" else "acc_lim_theta": 12.0})
    robot = PaperRobot(START, world.acceleration)
    near = side * 0.18 * world.scale
    wall = boxes((-9.0 * world.scale, min(near, 9.0 * near), 9.0 * world.stretch, max(near, 9.0 * near)))
    controller.set_path(world.path((0, 0), (6.0, 0)), True)
    back = world.path((0, 0), (0.02, side * 0.01), (-2.0, side * 0.01))
    for cycle in range(35):
        if cycle == 20:
            came_to = robot.pose
        if cycle >= 20:  # as planned anew from where the robot is
            place = Pose2D(robot.pose.x, robot.pose.y, came_to.theta)
            controller.set_path(Path(place.transform_poses(back.poses), "odom"), False)
        now = cycle * PERIOD
        state = ControlState(now, robot.pose, robot.velocity, world.costmap(robot.pose, wall), IDENTITY, PERIOD)
        try:
            command = controller.compute_velocity(state)
        except ControlError:
            command = STOP
        robot.move(command, PERIOD)
        assert not touches(robot.pose, wall, world.footprint), f"after {now:.1f} s at {robot.velocity}"


def test_it_turns_on_the_spot(name, size, speed):
    world = scaled(size, speed)
    ended, robot = world.drive(world.controller(name), Path(np.array([[0.0, 0.0, 2.5]]), "odom"))
    assert ended.reached and math.hypot(robot.pose.x, robot.pose.y) <= 0.05 * world.scale


def test_wheels_that_do_not_turn_are_stuck(name, size, speed):
    world = scaled(size, speed)
    controller = world.controller(name)
    controller.set_path(world.path((0, 0), (1.5, 0)), True)
    costmap = world.costmap(START)
    with pytest.raises(ControlError) as stuck:
        for cycle in range(100):
            controller.compute_velocity(ControlState(cycle * PERIOD, START, STOP, costmap, IDENTITY, PERIOD))
    assert stuck.value.outcome is ControlOutcome.ROBOT_STUCK
