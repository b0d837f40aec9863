"""Foresight: what moves is met nowhere the robot could have braked before, and it does not stay in anybody's way."""

import dataclasses
import math

import numpy as np
import pytest
from kinematics import BURGER, TURTLEBOT3, PaperRobot, costmap_round, path_through

from mbf_relay.control import CONTROLLERS
from mbf_relay.control.braking import arc, stopping_time
from mbf_relay.control.controller import Controller
from mbf_relay.control.foresight import BETTER, Foresight
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import IDENTITY, STOP, Pose2D
from mbf_relay.outcomes import ControlError
from mbf_relay.plugins import create
from mbf_relay.tracking.track import Track

DWA, PURSUIT = "dwa_local_planner/DWAPlannerROS", "regulated_pure_pursuit"
START = Pose2D(0.0, 0.0, 0.0)


def make(name, **changes):
    extra = {"desired_linear_vel": 0.22} if name == PURSUIT else {}
    return create(name, name, {**TURTLEBOT3, **extra, **changes}, Controller, CONTROLLERS)


def mover(x, y, vx, vy, radius=0.1, now=0.0):
    return Track(1, now, x, y, vx, vy, radius, 1e-4, 0.0, 1e-4)


def state(pose, velocity, now, *tracks):
    costmap = dataclasses.replace(costmap_round(pose, now=now), tracks=tracks)
    return ControlState(now, pose, velocity, costmap, IDENTITY, 0.1)


def marked(seen):
    """Return a state in which what moves is marked where it is, as the obstacle layer marks it."""
    costmap = seen.costmap
    grid, costs = costmap.grid, costmap.costs.copy()
    rows, columns = np.mgrid[:grid.height, :grid.width]
    for track in costmap.tracks:
        x = grid.origin_x + (columns + 0.5) * grid.resolution - track.x
        y = grid.origin_y + (rows + 0.5) * grid.resolution - track.y
        costs[np.hypot(x, y) <= track.radius] = LETHAL
    return dataclasses.replace(seen, costmap=dataclasses.replace(costmap, costs=costs))


def test_foresight_without_anything_that_tracks_is_told_of():
    controller = make(DWA, foresight=True)
    controller.set_path(path_through((0, 0), (2, 0)), True)
    with pytest.warns(RuntimeWarning, match="track_layer"):
        controller.compute_velocity(ControlState(0.0, START, STOP, costmap_round(START, now=0.0), IDENTITY, 0.1))


def gap(pose, track):
    """Return the distance (m) from the burger's outline to a track's disc, by small boxes."""
    local = Pose2D(track.x, track.y, 0.0).relative_to(pose)
    dx = max(BURGER[:, 0].min() - local.x, 0.0, local.x - BURGER[:, 0].max())
    dy = max(BURGER[:, 1].min() - local.y, 0.0, local.y - BURGER[:, 1].max())
    return math.hypot(dx, dy) - track.radius


def drive(controller, track, seconds=12.0, goal=(2.0, 0.0), seen_as=lambda seen: seen):
    """Return gaps and poses of a drive, along x if nothing else is said, while a track goes on as it does."""
    robot, gaps, poses = PaperRobot(START), [], []
    controller.set_path(path_through((0, 0), goal), True)
    for cycle in range(int(seconds / 0.1)):
        now = 0.1 * cycle
        try:
            command = controller.compute_velocity(seen_as(state(robot.pose, robot.velocity, now, track.at(now))))
        except ControlError:
            command = STOP
        robot.move(command, 0.1)
        gaps.append(gap(robot.pose, track.at(now + 0.1)))
        poses.append(robot.pose)
    return gaps, poses


@pytest.mark.parametrize("track", [
    mover(0.8, 0.9, 0.0, -0.25), mover(0.9, -1.0, 0.0, 0.25), mover(0.6, 0.8, 0.05, -0.2),
])
def test_a_lane_is_crossed_before_or_after_who_comes_along_it(track):
    gaps, poses = drive(make(DWA, foresight=True), track)
    assert min(gaps) > 0.0 and poses[-1].x > 1.5


def test_without_foresight_the_robot_drives_into_who_comes():
    gaps, _ = drive(make(DWA, foresight=False), mover(0.8, 0.75, 0.0, -0.2))
    assert min(gaps) <= 0.0


@pytest.mark.parametrize("name", [DWA, PURSUIT, "mppi"])
def test_a_robot_in_somebodys_lane_gets_out_of_it(name):
    track = mover(0.05, 0.9, 0.0, -0.2)
    gaps, _ = drive(make(name, foresight=True), track, seconds=9.0)
    standing = min(gap(START, track.at(0.1 * cycle)) for cycle in range(90))
    assert standing < 0.0 < min(gaps)


@pytest.mark.parametrize("name", [DWA, PURSUIT, "mppi"])
def test_no_command_is_one_from_which_the_robot_braking_would_touch_what_is_tracked(name):
    rng = np.random.default_rng(4)
    controller = make(name, foresight=True)
    for number in range(40):
        angle, speed = rng.uniform(-math.pi, math.pi), rng.uniform(0.05, 0.4)
        track = mover(*rng.uniform(-0.6, 0.6, 2), speed * math.cos(angle), speed * math.sin(angle))
        now = 10.0 * number
        controller.set_path(path_through((0, 0), tuple(rng.uniform(-1.0, 1.0, 2))), True)
        seen = state(START, STOP, now, track._replace(stamp=now))
        try:
            command = controller.compute_velocity(seen)
        except ControlError:
            continue
        if command == STOP:
            continue
        duration = stopping_time(controller.parameters, command, 0.1)
        poses = arc(FootprintChecker(seen.costmap), seen, command, duration)
        foresight = Foresight(seen.costmap, START, now, controller.parameters)
        met = foresight.meetings(poses[None], np.array([len(poses)]), np.array([duration / len(poses)]))[0]
        assert met > duration or met > foresight.meeting_of_standing(START) - BETTER, number


@pytest.mark.parametrize("name", [DWA, PURSUIT, "mppi"])
@pytest.mark.parametrize("angle", [0.0, 1.2, 2.5, -1.8])
def test_who_comes_faster_than_the_robot_drives_is_let_past_from_any_side(name, angle):
    away, speed = 1.2, 0.35
    x, y = away * math.cos(angle), away * math.sin(angle)
    track = mover(x, y, -speed * x / away, -speed * y / away)
    gaps, _ = drive(make(name, foresight=True, foresight_horizon=3.0), track, seconds=6.0, goal=(-2.0, 0.3))
    assert min(gaps) > 0.0


@pytest.mark.parametrize("name", [DWA, PURSUIT, "mppi"])
@pytest.mark.parametrize("angle", [0.0, 0.5, 3.0])
@pytest.mark.parametrize("speed", [0.15, 0.3])
def test_who_stands_between_the_robot_and_its_path_is_fled_from_at_the_robots_speed(name, angle, speed):
    x, y = 0.6 * math.cos(angle), 0.6 * math.sin(angle)
    track = mover(x, y, -speed * x / 0.6, -speed * y / 0.6)
    gaps, _ = drive(make(name, foresight=True), track, seconds=6.0, seen_as=marked)
    assert min(gaps) > 0.0


@pytest.mark.parametrize("name", [DWA, PURSUIT, "mppi"])
def test_what_appears_inside_the_footprint_or_jumps_about_makes_no_command_that_was_not_checked(name):
    rng = np.random.default_rng(3)
    controller = make(name, foresight=True)
    controller.set_path(path_through((0, 0), (2.0, 0)), True)
    robot = PaperRobot(START)
    for cycle in range(60):
        now = 0.1 * cycle
        place = np.array(robot.pose[:2]) + rng.uniform(-0.3, 0.3, 2)
        track = mover(*place, *rng.uniform(-2.0, 2.0, 2), radius=rng.uniform(0.01, 0.5), now=now)
        seen = state(robot.pose, robot.velocity, now, track)
        try:
            command = controller.compute_velocity(seen)
        except ControlError:
            command = STOP
        assert np.isfinite(command).all() and command.speed() <= 0.22 + 1e-6 and abs(command.theta) <= 2.75 + 1e-6
        if command != STOP:
            before = Foresight(seen.costmap, robot.pose, now, controller.parameters)
            duration = stopping_time(controller.parameters, command, 0.1)
            poses = arc(FootprintChecker(seen.costmap), seen, command, duration)
            met = before.meetings(poses[None], np.array([len(poses)]), np.array([duration / len(poses)]))[0]
            is_stop = command.speed() <= robot.velocity.speed() and abs(command.theta) <= abs(robot.velocity.theta)
            assert met > duration or met > before.meeting_of_standing(robot.pose) - BETTER or is_stop, cycle
        robot.move(command, 0.1)


def test_from_what_touches_already_the_robot_may_go_away_and_not_nearer():
    seen = state(START, STOP, 0.0, mover(0.12, 0.0, 0.0, 0.0, radius=0.1)).costmap
    foresight = Foresight(seen, START, 0.0, make(DWA, foresight=True).parameters)
    ways = np.array([[(sign * 0.02 * step, 0.0, 0.0) for step in range(1, 6)] for sign in (1.0, -1.0)])
    nearer, away = foresight.meetings(ways, np.full(2, 5), np.full(2, 0.1))
    assert nearer <= 0.1 and away == math.inf


def test_a_robot_whose_wheels_are_late_foresees_from_when_its_commands_take_effect():
    """Its trajectories began where it would be in 0.8 s, and people were foreseen from where they were now."""
    somebody = mover(1.4, 0.0, -0.5, 0.0)
    costs = []
    for now, delay in (0.0, 0.8), (0.8, 0.0):
        controller = make(DWA, foresight=True)
        controller.set_path(path_through((0, 0), (2, 0)), True)
        seen = dataclasses.replace(state(START, STOP, now, somebody), commanded=STOP, delay=delay)
        controller.compute_velocity(seen)
        explanation = controller.explanation
        costs.append(explanation.scores[explanation.names.index("foresight")])
    assert np.isfinite(costs[1]).any() and (costs[1] > 0.0).any()
    np.testing.assert_allclose(costs[0], costs[1])


def test_the_time_of_a_meeting_is_when_it_happens():
    foresight = Foresight(
        state(START, STOP, 0.0, mover(0.6, 0.0, -0.2, 0.0)).costmap, START, 0.0, make(DWA, foresight=True).parameters
    )
    expected = (0.6 - 0.041 - 0.1) / 0.2
    blind = Foresight(state(START, STOP, 0.0).costmap, START, 0.0, make(DWA, foresight=True).parameters)
    assert foresight.meeting_of_standing(START) == math.inf or foresight.meeting_of_standing(START) <= expected + 0.1
    assert Foresight(
        state(START, STOP, 0.0, mover(0.4, 0.0, -0.2, 0.0)).costmap, START, 0.0, make(DWA, foresight=True).parameters
    ).meeting_of_standing(START) == pytest.approx((0.4 - 0.141) / 0.2, abs=0.2)
    assert blind.is_blind and blind.meeting_of_standing(START) == math.inf


def nearing(before, pose, track):
    """Return by how much (m) the robot came nearer by its own motion to where a track is."""
    return gap(before, track) - gap(pose, track)


@pytest.mark.parametrize("name", [DWA, PURSUIT, "mppi"])
@pytest.mark.parametrize("after", [0.8, 1.2, 1.6])
def test_who_walks_ahead_and_turns_back_is_not_run_into_before_that_is_seen(name, after):
    """A robot followed who walked as fast as itself, and hit him before the tracker knew that he had turned."""
    controller, robot, speed, lag = make(name, foresight=True), PaperRobot(START), 0.25, 0.6
    controller.set_path(path_through((0, 0), (3.0, 0)), True)
    came_nearer, gaps = [], []
    for cycle in range(40):
        now = 0.1 * cycle
        turned = now - after
        place = 0.35 + speed * (now if turned < 0.0 else after - turned)
        seen = mover(place, 0.0, speed if turned < lag else -speed, 0.0, now=now)
        try:
            command = controller.compute_velocity(state(robot.pose, robot.velocity, now, seen))
        except ControlError:
            command = STOP
        before = robot.pose
        robot.move(command, 0.1)
        gaps.append(gap(robot.pose, seen._replace(x=place)))
        came_nearer.append(nearing(before, robot.pose, seen))
        if gaps[-1] <= 0.02:
            break
    assert came_nearer[-1] < 0.001, gaps[-5:]


@pytest.mark.parametrize("name", [DWA, PURSUIT, "mppi"])
def test_no_command_brings_the_robot_braking_into_anybody_wherever_he_turns(name):
    rng = np.random.default_rng(5)
    controller, moved = make(name, foresight=True), 0
    for number in range(60):
        angle, speed = rng.uniform(-math.pi, math.pi), rng.uniform(0.05, 0.4)
        track = mover(*rng.uniform(-0.6, 0.6, 2), speed * math.cos(angle), speed * math.sin(angle))
        if gap(START, track) <= 0.0:
            continue
        now = 10.0 * number
        controller.set_path(path_through((0, 0), tuple(rng.uniform(-1.0, 1.0, 2))), True)
        seen = state(START, STOP, now, track._replace(stamp=now))
        try:
            command = controller.compute_velocity(seen)
        except ControlError:
            continue
        moved += command != STOP
        duration = stopping_time(controller.parameters, command, 0.1)
        poses = arc(FootprintChecker(seen.costmap), seen, command, duration)
        for index, pose in enumerate(poses.tolist()):
            time = (index + 1) * duration / len(poses)
            left = gap(Pose2D(*pose), track)
            assert left >= speed * time or left >= gap(START, track) - 0.0021, number
    assert moved > 20


def test_who_could_be_run_into_is_found_as_by_one_pose_after_the_other():
    rng = np.random.default_rng(6)
    tracks = [mover(*rng.uniform(-0.5, 0.5, 2), *rng.uniform(-0.5, 0.5, 2), radius=rng.uniform(0.05, 0.2))
              for _ in range(6)]
    tracks = [track for track in tracks if gap(START, track) > 0.0]
    seen, counts, steps = state(START, STOP, 0.0, *tracks).costmap, rng.integers(1, 9, 300), rng.uniform(0.02, 0.1, 300)
    poses = np.cumsum(rng.normal((0.0, 0.0, 0.0), (0.03, 0.03, 0.1), (300, 8, 3)), axis=1)
    found = Foresight(seen, START, 0.0, make(DWA, foresight=True).parameters).runs_into(poses, counts, steps)
    expected = [
        any(gap(pose, track) < min((index + 1) * step * track.speed, gap(START, track) - 0.002)
            for track in tracks for index, pose in enumerate(map(Pose2D._make, way[:count].tolist())))
        for way, count, step in zip(poses, counts, steps)
    ]
    assert found.tolist() == expected and 30 < sum(expected) < 270
