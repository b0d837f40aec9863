"""What one beam alone hits: readings that sunlight, dust or rain make, and legs that are as thin."""

import math

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.lone_hits import APART, REMEMBERED, LoneHits
from mbf_relay.costmap.observation import observation_from_scan
from mbf_relay.geometry import IDENTITY
from mbf_relay.scan import LaserScan

BEAMS = 360
AHEAD = 180
"""The beam that looks along x."""


def lidar_costmap():
    return build_costmap("costmap", {
        "global_frame": "map", "width": 6.0, "height": 6.0, "resolution": 0.05, "origin_x": -3.0, "origin_y": -3.0,
        "robot_radius": 0.1, "plugins": [{"name": "obstacles", "type": "costmap_2d::ObstacleLayer"}],
        "obstacles": {"observation_sources": "scan", "scan": {
            "data_type": "LaserScan", "marking": True, "clearing": True}},
    })


def see(costmap, readings=None, beams=BEAMS, stamp=1.0):
    """Show a costmap an empty place of 2.4 m around, with other readings (m) by their beams; return what is lethal."""
    ranges = np.full(beams, 2.4)
    for beam, reading in (readings or {}).items():
        ranges[beam] = reading
    scan = LaserScan(ranges, -math.pi, 2.0 * math.pi / beams, 0.1, 3.5, stamp)
    costmap.observe("scan", observation_from_scan(scan, IDENTITY))
    costmap.update(stamp, IDENTITY)
    grid = costmap.snapshot()
    return lambda x, y: grid.costs[grid.grid.cell_at(x, y)[::-1]] == LETHAL


def test_a_ray_of_sunlight_does_not_stand_in_the_way():
    costmap = lidar_costmap()
    see(costmap)
    assert not see(costmap, {AHEAD: 1.0}, stamp=1.2)(1.0, 0.0)
    assert not see(costmap, {AHEAD + 40: 0.7}, stamp=1.4)(1.0, 0.0)


def test_a_leg_as_thin_as_one_beam_stands_in_the_way_from_its_second_scan_on():
    costmap = lidar_costmap()
    see(costmap)
    assert not see(costmap, {AHEAD: 1.0}, stamp=1.2)(1.0, 0.0)
    assert see(costmap, {AHEAD: 1.02}, stamp=1.4)(1.02, 0.0)


def test_a_leg_that_every_second_scan_misses_stands_in_the_way():
    costmap = lidar_costmap()
    see(costmap)
    see(costmap, {AHEAD: 1.0}, stamp=1.2)
    see(costmap, stamp=1.4)
    assert see(costmap, {AHEAD + 1: 1.0}, stamp=1.6)(math.cos(math.pi / 180.0), math.sin(math.pi / 180.0))


def test_what_the_first_scan_shows_counts_though_one_beam_alone_hits_it():
    assert see(lidar_costmap(), {AHEAD: 1.0})(1.0, 0.0)


@pytest.mark.parametrize("readings", [
    {AHEAD: 1.0, AHEAD + 1: 1.0}, {AHEAD: 1.0, AHEAD + 1: 1.0 + 0.9 * APART}, {AHEAD: 1.0, AHEAD - 1: 0.3},
], ids=["two beams", "its edge", "behind another's side"])
def test_a_foot_put_before_the_wheel_counts_at_once(readings):
    costmap = lidar_costmap()
    see(costmap)
    assert see(costmap, readings, stamp=1.2)(1.0, 0.0)


def test_a_lidar_with_few_beams_shows_what_it_hits_at_once():
    costmap = lidar_costmap()
    see(costmap, beams=36)
    assert see(costmap, {18: 1.0}, beams=36, stamp=1.2)(1.0, 0.0)


def test_a_lidar_that_looks_ahead_shows_at_once_what_its_outermost_beam_hits():
    lone = LoneHits()
    bearings = np.radians(np.arange(-45.0, 46.0))
    far = 2.0 * np.column_stack((np.cos(bearings), np.sin(bearings)))
    lone.without(0.0, 0.0, far, far)
    ends = far.copy()
    ends[[0, 40, 90]] *= 0.5
    assert lone.without(0.0, 0.0, ends, ends).tolist() == np.delete(ends, 40, axis=0).tolist()


def test_a_scan_of_nothing_is_no_error():
    lone, nothing = LoneHits(), np.empty((0, 2))
    for _ in range(3):
        assert len(lone.without(0.0, 0.0, nothing, nothing)) == 0


def plain(x, y, ends, marks, before):
    """Return the marks that count, one after the other."""
    kept = []
    polar = sorted((math.atan2(end[1] - y, end[0] - x), math.hypot(end[0] - x, end[1] - y)) for end in ends)
    for mark in marks:
        bearing, distance = math.atan2(mark[1] - y, mark[0] - x), math.hypot(mark[0] - x, mark[1] - y)
        own = [other for other, _ in polar].index(bearing)
        alone = all(
            abs(math.sin(other - bearing)) * distance <= APART and reading >= distance + APART
            for other, reading in (polar[own - 1], polar[(own + 1) % len(polar)]))
        seen = any(math.hypot(*(mark - other)) < APART for scan in before for other in scan)
        if not (alone and before) or seen:
            kept.append(mark)
    return np.array(kept).reshape(-1, 2)


@pytest.mark.parametrize("seed", range(8))
def test_what_counts_is_what_a_plain_look_at_each_beam_says(seed):
    rng, lone, before = np.random.default_rng(seed), LoneHits(), []
    for _ in range(5):
        x, y = rng.uniform(-1.0, 1.0, 2)
        bearings = np.sort(rng.uniform(-math.pi, math.pi, 120))
        ranges = np.where(rng.random(120) < 0.3, rng.uniform(0.2, 3.0, 120), 2.5)
        ends = np.column_stack((x + ranges * np.cos(bearings), y + ranges * np.sin(bearings)))
        marks = ends[rng.random(120) < 0.8]
        assert np.array_equal(lone.without(x, y, ends, marks), plain(x, y, ends, marks, before))
        before = (before + [marks])[-REMEMBERED:]
