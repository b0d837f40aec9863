"""Lidars that see the robot's own mast and pillars, as on most robots with a deck above the lidar."""

import math

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.costmap.observation import Observation
from mbf_relay.costmap.outline import are_own, clearances
from mbf_relay.geometry import IDENTITY, Pose2D

FOOTPRINT = [[0.14, 0.13], [-0.14, 0.13], [-0.14, -0.13], [0.14, -0.13]]
POSTS = np.radians([45.0, 135.0, 225.0, 315.0])
LIDAR = Pose2D(-0.02, 0.0, 0.3)
ROOM = 1.9


def local_costmap(**values):
    return build_costmap("local_costmap", {
        "global_frame": "odom", "width": 5.0, "height": 5.0, "origin_x": -2.5, "origin_y": -2.5, "resolution": 0.05,
        "footprint": FOOTPRINT, "obstacle_range": 3.0, "raytrace_range": 3.0, "observation_sources": "scan",
        "scan": {"data_type": "LaserScan", "marking": True, "clearing": True}, "track_layer": {}, **values,
    })


def seen_from(base, stamp, thing=None):
    """Return what a lidar sees of a square room, a thing at so many metres on each side, and four posts of its robot.
    """
    sensor = base.compose(LIDAR)
    bearings = np.radians(np.arange(360.0))
    dx, dy = np.cos(bearings + sensor.theta), np.sin(bearings + sensor.theta)
    ranges = np.full(360, math.inf)
    for start, step in ((sensor.x, dx), (sensor.y, dy)):
        ranges = np.minimum(ranges, (np.copysign(ROOM, step) - start) / np.where(step == 0.0, 1e-9, step))
    for post in POSTS:
        off = np.abs(np.remainder(bearings + LIDAR.theta - post + math.pi, 2.0 * math.pi) - math.pi)
        ranges[off < 0.1] = 0.1
    if thing is not None:
        ranges = np.minimum(ranges, thing)
    ends = np.column_stack((sensor.x + ranges * dx, sensor.y + ranges * dy))
    return Observation(tuple(sensor[:2]), ends, None, stamp, heading=sensor.theta, base=base)


def test_a_robot_whose_lidar_sees_its_own_pillars_is_not_in_collision_with_them_and_follows_none():
    """They lay on cells its outline crosses, and stood where they had been seen as it drove on: people who walk along.

    It had stood there, or crept on through what it took for people, till its time was up.
    """
    costmap, base = local_costmap(), IDENTITY
    for step in range(40):
        base = base.compose(Pose2D(0.03, 0.0, 0.05))
        costmap.observe("scan", seen_from(base, 1.0 + 0.2 * step), 1.0 + 0.2 * step)
        costmap.update(1.0 + 0.2 * step, base)
        snapshot = costmap.snapshot()
        marked = snapshot.grid.centers_of(np.argwhere(snapshot.costs == LETHAL)[:, ::-1])
        assert (clearances(base.inverse().transform_points(marked), costmap.outline) > 0.0).all(), step
        assert not snapshot.tracks, step


@pytest.mark.parametrize("thing", [0.13, 0.2])
def test_what_is_at_the_robots_edge_or_beyond_is_an_obstacle(thing):
    costmap = local_costmap(footprint_padding=0.0)
    seen = seen_from(IDENTITY, 1.0, thing)
    costmap.observe("scan", seen, 1.0)
    costmap.update(1.0, IDENTITY)
    snapshot = costmap.snapshot()
    beyond = np.maximum(np.abs(seen.points[:, 0]) - 0.14, np.abs(seen.points[:, 1]) - 0.13) > 0.0
    cells = snapshot.grid.cells_at(seen.points[beyond])
    assert beyond.any() and (snapshot.costs[cells[:, 1], cells[:, 0]] == LETHAL).all()


def test_what_stands_in_the_padding_is_an_obstacle_and_no_part_of_the_robot():
    """It was taken for the robot's own and its cells for free, and the robot drove into what stood right before it."""
    costmap = local_costmap(footprint_padding=0.1)
    near = np.array([[0.19, y] for y in np.linspace(-0.1, 0.1, 21)])
    costmap.observe("scan", Observation((0.0, 0.0), near, None, 1.0, base=IDENTITY), 1.0)
    costmap.update(1.0, IDENTITY)
    snapshot = costmap.snapshot()
    cells = snapshot.grid.cells_at(near)
    assert (snapshot.costs[cells[:, 1], cells[:, 0]] == LETHAL).all()
    assert FootprintChecker(snapshot).free_steps(np.array([[0.02, 0.0, 0.0]]), IDENTITY) == 0
    assert FootprintChecker(snapshot).free_steps(np.array([[-0.02, 0.0, 0.0]]), IDENTITY) == 1


def test_a_lidar_that_stands_in_the_world_may_look_at_the_robot():
    """It does not tell what is the robot's, as nobody knows where that was when it looked."""
    seen = Observation((2.0, 0.0), np.array([[0.0, 0.0]]), None, 1.0, rides=False)
    assert seen.without_robot(np.array(FOOTPRINT)) is seen


def test_what_lies_under_the_robot_s_edge_is_free_after_the_scan_that_shows_it():
    """The cells it stands on were freed before the scan was marked, and it stood on an obstacle of its own making."""
    costmap = local_costmap(footprint_padding=0.0, resolution=0.02)
    edge = np.array([[0.115, 0.01], [1.01, 0.01]])  # 2.5 cm within the outline, and far from it
    costmap.observe("scan", Observation((0.0, 0.0), edge, None, 1.0, base=IDENTITY), 1.0)
    costmap.update(1.0, IDENTITY)
    snapshot = costmap.snapshot()
    costs = [snapshot.costs[snapshot.grid.cell_at(*point)[::-1]] for point in edge]
    assert costs[0] < LETHAL and costs[1] == LETHAL


@pytest.mark.filterwarnings("error")
def test_points_as_far_away_as_numbers_go_are_not_the_robot_s_own_and_nothing_is_said_of_them():
    points = np.array([[1e300, 0.0], [0.0, -1e308], [math.inf, 0.0], [math.nan, 0.0], [1.0, 2.0]])
    own = are_own(points, Pose2D(1.0, 2.0, 0.5), np.array(FOOTPRINT))
    assert own.tolist() == [False, False, False, False, True]
