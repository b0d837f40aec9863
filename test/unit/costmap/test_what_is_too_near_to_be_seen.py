"""A lidar that measures nothing nearer than half a metre drives past a box: its corner must not go, ray by ray."""

import math

import numpy as np
import pytest

from mbf_relay.costmap import factory
from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL
from mbf_relay.costmap.observation import observation_from_scan
from mbf_relay.geometry import Pose2D
from mbf_relay.scan import LaserScan

LEFT, RIGHT, LOW, HIGH = 1.02, 1.48, 0.27, 0.73
"""The box (m)."""
BEAMS = 720


def costmap():
    source = {"data_type": "LaserScan", "marking": True, "clearing": True, "obstacle_range": 3.0}
    return factory.build_costmap("local_costmap", {
        "global_frame": "odom", "width": 4.0, "height": 4.0, "resolution": 0.05, "origin_x": -1.0, "origin_y": -1.0,
        "robot_radius": 0.1, "footprint_padding": 0.0, "plugins": [
            {"name": "obstacles", "type": "costmap_2d::ObstacleLayer"}],
        "obstacles": {"observation_sources": "scan", "scan": source, "footprint_clearing_enabled": False}})


def scan_from(x, y, stamp, range_min, nothing=0.0, there=True):
    """Return what a level lidar reads that looks along x; `nothing` where it measures nothing."""
    angles = -math.pi + 2.0 * math.pi / BEAMS * np.arange(BEAMS)
    with np.errstate(divide="ignore"):
        across = np.sort([(side - x) / np.cos(angles) for side in (LEFT, RIGHT)], axis=0)
        along = np.sort([(side - y) / np.sin(angles) for side in (LOW, HIGH)], axis=0)
    enters, leaves = np.maximum(across[0], along[0]), np.minimum(across[1], along[1])
    ranges = np.where((enters <= leaves) & (enters > 0.0) & there, enters, np.inf)
    ranges[ranges < range_min] = nothing
    return LaserScan(ranges, -math.pi, 2.0 * math.pi / BEAMS, range_min, 3.0, stamp)


def drive_past(made, range_min, nothing):
    for step, x in enumerate(np.arange(0.0, 1.25, 0.025)):
        scan = scan_from(x, 0.0, 0.1 * (step + 1), range_min, nothing)
        made.observe("scan", observation_from_scan(scan, Pose2D(x, 0.0, 0.0)), scan.stamp)
        made.update(scan.stamp, Pose2D(x, 0.0, 0.0))


def lethal(made):
    picture = made.snapshot()
    return {(int(column), int(row)) for row, column in np.argwhere(picture.costs == LETHAL)}


@pytest.mark.parametrize("nothing", [0.0, math.nan, 0.2, -math.inf])
def test_a_corner_nearer_than_the_lidar_can_see_stays_where_it_is(nothing):
    made, all_seen = costmap(), costmap()
    drive_past(made, 0.5, nothing)
    drive_past(all_seen, 0.05, nothing)
    picture = made.snapshot()
    front = {picture.grid.cell_at(x, LOW) for x in np.arange(LEFT, 1.2, 0.01)}  # before it is near, all of it is seen
    assert front <= lethal(all_seen)
    assert front <= lethal(made)


def test_what_has_gone_from_there_is_free_as_soon_as_all_beams_see():
    made = costmap()
    drive_past(made, 0.5, 0.0)
    scan = scan_from(1.25, 0.0, 9.0, 0.5, there=False)
    made.observe("scan", observation_from_scan(scan, Pose2D(1.25, 0.0, 0.0)), 9.0)
    made.update(9.0, Pose2D(1.25, 0.0, 0.0))
    picture = made.snapshot()
    column, row = picture.grid.cell_at(LEFT + 0.01, LOW + 0.01)
    assert picture.costs[row, column] == FREE_SPACE
    assert not lethal(made)
