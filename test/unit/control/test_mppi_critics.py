"""What MPPI's critics charge, on drives made by hand: by plain loops, each drive and each pose on its own."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from kinematics import boxes, costmap_round
from test_mppi import START, make

from mbf_relay.control.mppi.critic import POINT_SPACING
from mbf_relay.costmap.cost_grid import INSCRIBED
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D

GOAL = Pose2D(0.8, 0.3, 3.0)
OMNI = dict(motion_model="Omni", vy_max=0.2, acc_lim_y=2.5)
CAR = dict(motion_model="Ackermann", AckermannConstraints={"min_turning_r": 0.3})


def situation(name, values=None, goal_distance=1.0, furthest=24, blocked=(), **changes):
    """Return one of Nav2's critics with some of its parameters, and eight random drives along a bent path."""
    controller, rng = make(critics=[name], **{name: values or {}}, **changes), np.random.default_rng(1)
    dt, velocities = controller.parameters.model_dt, rng.uniform((-0.5, -0.3, -2.0), (0.9, 0.3, 2.0), (8, 40, 3))
    poses, drives = np.empty_like(velocities), [Pose2D(0.0, 0.0, heading) for heading in rng.uniform(-3.0, 3.0, 8)]
    for step in range(40):
        drives = [pose.compose(Pose2D(*velocities[n, step] * dt)) for n, pose in enumerate(drives)]
        poses[:, step] = drives
    bearings = np.concatenate((np.zeros(4), np.full(26, 2.8)))
    path = np.vstack((np.zeros(2), np.cumsum(POINT_SPACING * np.array([np.cos(bearings), np.sin(bearings)]).T, axis=0)))
    is_free = np.ones(len(path), bool)
    is_free[list(blocked)] = False
    halfway, ends = rng.uniform((0.0, -0.1), (0.4, 0.6), (2, 8, 2))
    checker = FootprintChecker(costmap_round(START, boxes((0.35, -0.2, 0.45, 0.2))))
    return controller.critics[0], SimpleNamespace(
        parameters=controller.parameters, pose=START, goal=GOAL, goal_distance=goal_distance, velocities=velocities,
        poses=poses, checker=checker, path=path, path_is_free=is_free, furthest=furthest, halfway=halfway, ends=ends)


def turned(one, other):
    return abs(math.remainder(one - other, 2.0 * math.pi))


def direction_at(path, index):
    x, y = path[min(index + 1, len(path) - 1)] - path[min(index, len(path) - 2)]
    return math.atan2(y, x)


def beyond(p, x, y, turn):
    speed = math.copysign(math.hypot(x, y), x) if p.max_vel_y else x
    slowest = -math.hypot(p.min_vel_x, p.max_vel_y)
    sharper = max(0.0, abs(turn) * p.min_turning_r - abs(x)) if p.motion_model == "Ackermann" else 0.0
    return max(0.0, speed - p.max_vel_trans, slowest - speed) + sharper


@pytest.mark.parametrize("name, values, changes, plain, on, off", [
    ("GoalCritic", {}, {}, lambda _p, pose, _v: math.hypot(pose[0] - GOAL.x, pose[1] - GOAL.y) / 40, 1.4, 1.5),
    ("GoalAngleCritic", {}, OMNI, lambda _p, pose, _v: turned(pose[2], GOAL.theta) / 40, 0.5, 0.6),
    ("PreferForwardCritic", {}, {}, lambda p, _pose, v: max(0.0, -v[0]) * p.model_dt, 0.5, 0.4),
    ("TwirlingCritic", {}, {}, lambda _p, _pose, v: abs(v[2]) / 40, 0.1, 0.05),
    ("VelocityDeadbandCritic", {"deadband_velocities": [0.1, -0.05, 0.3]}, OMNI, lambda p, _pose, v: p.model_dt * sum(
        max(0.0, dead - abs(each)) for dead, each in zip((0.1, 0.05, 0.3), v)), 0.0, None),
    ("VelocityDeadbandCritic", {"deadband_velocities": [0.1, 0.05, 0.3]}, {}, lambda p, _pose, v: p.model_dt * sum(
        max(0.0, dead - abs(each)) for dead, each in zip((0.1, 0.0, 0.3), v)), 0.0, None),
    *(("ConstraintCritic", {}, changes, lambda p, _pose, v: beyond(p, *v) * p.model_dt, 0.0, None)
      for changes in ({}, OMNI, CAR)),
])
def test_a_drive_is_charged_for_each_pose_and_velocity_where_the_critic_is_on(name, values, changes, plain, on, off):
    critic, data = situation(name, values, on, **changes)
    expected = [sum(plain(data.parameters, pose, v) for pose, v in zip(*drive))
                for drive in zip(data.poses, data.velocities)]
    assert critic.score(data) == pytest.approx(expected) and max(expected) > 0.01
    if off is not None:
        data.goal_distance = off
        assert critic.score(data) == 0.0


@pytest.mark.parametrize("with_turns", [False, True])
def test_a_drive_is_charged_for_how_far_it_is_from_its_path_at_equal_ways(with_turns):
    critic, data = situation(
        "PathAlignCritic", {"use_path_orientations": with_turns, "max_path_occupancy_ratio": 1.0}, blocked=(3, 4, 5, 6))
    expected = []
    for drive in data.poses:
        way, off = 0.0, []
        for before, (x, y, heading) in zip(drive[::4], drive[4::4]):
            way += math.hypot(x - before[0], y - before[1])
            index = min(int(way / POINT_SPACING + 0.5), data.furthest)
            turn = turned(heading, direction_at(data.path, index)) if with_turns else 0.0
            if data.path_is_free[index]:
                off.append(math.hypot(x - data.path[index, 0], y - data.path[index, 1], turn))
        expected.append(sum(off) / max(1, len(off)))
    assert critic.score(data) == pytest.approx(expected)


@pytest.mark.parametrize("blocked, keeps_to_it", [((3, 4), True), ((3, 4, 5), False), ((25, 26, 27), True)])
def test_a_robot_leaves_its_path_where_somebody_stands_on_it(blocked, keeps_to_it):
    critic, data = situation("PathAlignCritic", blocked=blocked)
    assert np.any(critic.score(data)) == keeps_to_it


@pytest.mark.parametrize("furthest, blocked, aim", [
    (10, (), 16), (10, (16, 17, 18), 19), (10, (15, 17), 16), (28, (), 30), (10, range(16, 31), 30)])
def test_a_drive_is_charged_for_what_is_left_to_the_first_free_point_ahead(furthest, blocked, aim):
    critic, data = situation("PathFollowCritic", goal_distance=2.0, furthest=furthest, blocked=blocked)
    halfway, ends = (np.array([math.hypot(off, aim * POINT_SPACING - along) for off, along in places])
                     for places in (data.halfway, data.ends))
    assert critic.score(data) == pytest.approx(0.15 * halfway + 0.85 * ends)
    data.goal_distance = 1.3
    assert critic.score(data) == 0.0


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_a_drive_is_charged_for_not_facing_a_point_of_the_path_ahead(mode):
    critic, data = situation("PathAngleCritic", {"mode": mode}, furthest=18)
    x, y = data.path[22]
    data.pose = Pose2D(x, y - 1.0, -0.5 if mode != 1 else 0.5)
    expected = []
    for end_x, end_y, heading in data.poses[:, -1]:
        bearing = math.atan2(y - end_y, x - end_x)
        off = turned(bearing, heading)
        away = mode == 2 and turned(bearing, direction_at(data.path, 22)) >= math.pi / 2.0
        expected.append(math.pi - off if away else min(off, math.pi - off) if mode == 1 else off)
    assert critic.score(data) == pytest.approx(expected)
    data.pose = Pose2D(x, y - 1.0, math.pi / 2.0 - 0.7)
    assert critic.score(data) == 0.0


@pytest.mark.parametrize("mode, costs", [(0, [0.0, math.pi]), (1, None), (2, [0.0, math.pi])])
def test_a_car_that_faces_away_from_where_its_path_leads_is_to_turn_round(mode, costs):
    """One told to face where its path leads (mode 2) was let drive all of it backwards."""
    critic, data = situation("PathAngleCritic", {"mode": mode})
    data.path = np.column_stack((POINT_SPACING * np.arange(31), np.zeros(31)))
    data.pose, data.poses = Pose2D(0.0, 0.0, math.pi), np.array([[(0.0, 0.0, 0.0)], [(0.0, 0.0, math.pi)]])
    assert critic.score(data) == (0.0 if costs is None else pytest.approx(costs))


@pytest.mark.parametrize("goal_distance", [0.4, 0.6])
def test_a_drive_into_something_costs_most_and_one_close_by_more_than_one_far_off(goal_distance):
    critic, data = situation("CostCritic", goal_distance=goal_distance)
    sums, highest = np.array([0, 90, 900, 2000, 0, 90, 900, 2000.0]), np.array([0, 9, 252, INSCRIBED] * 2)
    data.way, data.touches = SimpleNamespace(summed_costs=sums, highest_costs=highest), np.arange(8) >= 4
    plain = sums * (goal_distance >= 0.5) + 300.0 * (highest >= INSCRIBED)
    assert critic.score(data) == pytest.approx(np.where(data.touches, 1e6, plain) / (254 * 40))


@pytest.mark.parametrize("goal_distance", [0.4, 0.6])
def test_a_drive_is_charged_for_how_near_it_comes_to_a_wall(goal_distance):
    critic, data = situation("ObstaclesCritic", goal_distance=goal_distance)
    data.touches, expected = np.arange(8) >= 6, []
    for drive, touches in zip(data.poses, data.touches):
        rooms = np.maximum(0.0, data.checker.clearances_at(drive) - data.checker.costmap.inscribed_radius)
        near = 20.0 * sum(max(0.0, 0.1 - room) for room in rooms)
        around = 1.5 * sum(max(0.0, 0.55 - room) for room in rooms) / 40 if goal_distance >= 0.5 else 0.0
        expected.append(1e5 if touches else near + around)
    assert critic.score(data) == pytest.approx(expected) and max(expected[:6]) > 0.1
