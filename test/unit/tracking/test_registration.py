"""What odometry has wrong between two scans is taken for no motion of what stands."""

import math

import numpy as np
import pytest
from made_scans import scan

from mbf_relay.geometry import Pose2D
from mbf_relay.tracking import registration
from mbf_relay.tracking.clusters import rays_of
from mbf_relay.tracking.parameters import TrackerParameters
from mbf_relay.tracking.tracker import Tracker
from mbf_relay.tracking.tracker_kernels import match_scan, normal_equations

POSTS = [(0.8, 0.4, 0.05), (1.1, -0.5, 0.1), (-0.9, -0.5, 0.1), (-0.7, 1.2, 0.15), (0.2, 1.6, 0.2), (1.8, 1.5, 0.05)]
PERIOD = 0.2


def walls_of(rays, moving):
    return registration.walls_of(rays, 0.0, np.argsort(rays.bearings, kind="stable"), moving)


def slipping_drive(share, slip, discs=lambda t: POSTS, seconds=10.0, seed=3, lapses=0.0):
    """Yield the tracker after each scan of a robot that turns to and fro while it drives, whose wheels slip.

    And where odometry has the world: the pose of the world's frame in its own. Of the beams a share `lapses` at random.
    """
    tracker, rng = Tracker(TrackerParameters(track_odometry_error=share)), np.random.default_rng(seed)
    true = told = Pose2D(-1.0, 0.0, 0.0)
    for step in range(int(seconds / PERIOD)):
        t = step * PERIOD
        moved, turned = 0.2 * PERIOD, 1.5 * PERIOD * math.cos(1.2 * t)
        told = told.compose(Pose2D(moved, 0.0, turned))
        true = true.compose(Pose2D((1.0 - slip) * moved, 0.0, (1.0 - slip) * turned))
        world_in_odometry = told.compose(true.inverse())
        ends, hits = scan(true.x, true.y, discs(t), rng, true.theta)
        read = rng.random(len(hits)) >= lapses
        ends = world_in_odometry.transform_points(ends[read])
        tracker.update(told.x, told.y, ends, hits[read], 10.0 + t, told.theta if lapses else None)
        yield tracker, world_in_odometry


@pytest.mark.parametrize("slip", [0.1, 0.3, -0.2])
def test_nothing_that_stands_comes_towards_a_robot_whose_wheels_slip(slip):
    """It danced before a box for a minute, out of the way of posts that seemed to come."""
    assert sum(len(tracker.tracks) for tracker, _ in slipping_drive(0.3, slip)) == 0
    if slip == 0.3:
        assert sum(len(tracker.tracks) for tracker, _ in slipping_drive(0.0, slip)) > 20  # they do seem to


@pytest.mark.parametrize("lapses", [0.01, 0.3])
@pytest.mark.parametrize("slip", [0.3, -0.2])
def test_nothing_that_stands_comes_towards_it_either_where_beams_of_its_lidar_lapse(slip, lapses):
    """Scans of one beam more or less were not laid on each other: it saw people all round, and danced again."""
    assert sum(len(tracker.tracks) for tracker, _ in slipping_drive(0.3, slip, lapses=lapses)) == 0


def test_who_walks_is_where_odometry_sees_him_though_it_goes_astray():
    def walk(t):
        return [*POSTS, (1.5, -1.5 + 0.25 * t, 0.12)]

    seen = 0
    for step, (tracker, world) in enumerate(slipping_drive(0.3, 0.3, walk)):
        for track in tracker.tracks:
            there = world.transform_points(np.array([[1.5, -1.5 + 0.25 * step * PERIOD]]))[0]
            assert math.dist((track.x, track.y), there) < 0.25
            along = world.theta + math.pi / 2.0
            if step > 25:
                assert (track.vx, track.vy) == pytest.approx((0.25 * math.cos(along), 0.25 * math.sin(along)), abs=0.12)
                seen += 1
    assert seen > 10


def test_a_robot_that_stands_is_turned_by_nobody_who_walks_past():
    rays = rays_of(0.0, 0.0, *scan(0.0, 0.0, [(0.6, 0.0, 0.4)], np.random.default_rng(1)))
    ends, hits = scan(0.0, 0.0, [(0.6, 0.3, 0.4)], np.random.default_rng(2))
    walls = walls_of(rays, np.zeros(len(rays.hits), bool))
    assert registration.odometry_correction(walls, 0.0, 0.0, 0.0, ends, hits, 0.3) is None


@pytest.mark.parametrize("seed", range(10))
def test_a_scan_is_put_back_to_where_the_one_before_says_it_was(seed):
    rng = np.random.default_rng(seed)
    before = rays_of(0.0, 0.0, *scan(0.0, 0.0, POSTS, rng))
    walls = walls_of(before, np.zeros(len(before.hits), bool))
    true = Pose2D(*rng.uniform(-0.1, 0.1, 2), rng.uniform(-0.4, 0.4))
    told = Pose2D(1.2 * true.x, 0.8 * true.y, 1.25 * true.theta)
    ends, hits = scan(true.x, true.y, POSTS, rng, true.theta)
    wrong = told.compose(true.inverse())
    found = registration.odometry_correction(walls, *told, wrong.transform_points(ends), hits, 0.3)
    left = found.compose(told).relative_to(true)
    assert math.hypot(left.x, left.y) < 0.012 and abs(left.theta) < 0.012


@pytest.mark.parametrize("seed", range(10))
def test_what_pulls_is_each_reading_s_distance_to_the_line_it_meets(seed):
    rng = np.random.default_rng(seed)
    before = rays_of(0.0, 0.0, *scan(0.0, 0.0, POSTS, rng))
    walls = walls_of(before, rng.random(len(before.hits)) < 0.2)
    x, y, motion = 0.05, -0.1, np.array([0.02, 0.01, 0.05])
    ends, hits = scan(x, y, POSTS, rng, 0.1)
    found, expected = np.empty((3, 4)), np.zeros((3, 4))
    normal_equations(0.0, 0.0, walls.directions, walls.points, walls.solid, x, y, ends, hits, motion, 0.25, 0.02, found)
    size = len(walls.points)
    for end in ends[hits]:
        arm = np.array([[math.cos(0.05), -math.sin(0.05)], [math.sin(0.05), math.cos(0.05)]]) @ (end - (x, y))
        place = (x, y) + motion[:2] + arm
        last = int(np.searchsorted(walls.directions, math.atan2(place[1], place[0])))
        first = last - 1
        for _ in range(4):
            along = walls.points[last % size] - walls.points[first % size]
            if np.hypot(*along) >= 0.08:
                break
            first, last = first - 1, last + 1
        length = float(np.hypot(*along))
        if walls.solid[first % size] and walls.solid[last % size] and 0.08 <= length <= 0.3:
            normal = np.array([-along[1], along[0]]) / length
            off = float(normal @ (place - walls.points[first % size]))
            if abs(off) <= 0.25:
                row = np.array([*normal, normal[1] * arm[0] - normal[0] * arm[1]])
                expected += np.column_stack((np.outer(row, row), row * off)) / (0.02 ** 2 + off ** 2)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_a_scan_is_laid_where_each_step_s_normal_equations_with_the_prior_say(seed):
    rng = np.random.default_rng(seed)
    before = rays_of(0.0, 0.0, *scan(0.0, 0.0, POSTS, rng))
    walls = walls_of(before, rng.random(len(before.hits)) < 0.2)
    x, y, prior, gates = 0.05, -0.1, rng.uniform(1.0, 1e4, 3), np.array((0.5, 0.12))
    ends, hits = scan(x, y, POSTS, rng, 0.1)
    taken = (0.0, 0.0, walls.directions, walls.points, walls.solid, x, y, ends, hits)
    expected, system = np.zeros(3), np.empty((3, 4))
    for gate in gates:
        normal_equations(*taken, expected, gate, 0.02, system)
        expected -= np.linalg.solve(system[:, :3] + np.diag(prior), system[:, 3] + prior * expected)
    found = np.full(3, np.nan)
    match_scan(*taken, prior, gates, 0.02, found)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)
