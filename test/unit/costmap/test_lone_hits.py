"""What one beam alone hits: readings that sunlight, dust or rain make, and legs that are as thin."""

import math

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.lone_hits import (
    APART,
    DUSTY,
    LIKE_IN_DUST,
    REMEMBERED,
    REMEMBERED_IN_DUST,
    THIN_IN_DUST,
    LoneHits,
)
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


def dust(rng, share=0.1, beams=BEAMS):
    """Return the short readings (m) of a scan in dust by their beams."""
    return {int(beam): rng.uniform(0.12, 2.4) for beam in np.flatnonzero(rng.random(beams) < share)}


@pytest.fixture
def dusty():
    """Return a costmap that has seen dust for a while, and the generator of more."""
    rng, costmap = np.random.default_rng(3), lidar_costmap()
    for scan in range(12):
        see(costmap, dust(rng), stamp=1.0 + 0.2 * scan)
    return costmap, rng


def test_dust_in_every_tenth_beam_does_not_close_the_ways_round_a_robot(dusty):
    """Where dust is everywhere it lies beside other dust, and where other dust was, a dozen times a scan."""
    costmap, rng = dusty
    closed = []
    for scan in range(10):
        see(costmap, dust(rng), stamp=4.0 + 0.2 * scan)
        grid = costmap.snapshot()
        lethal = grid.grid.centers_of(np.argwhere(grid.costs == LETHAL)[:, ::-1])
        closed.append(np.count_nonzero(np.hypot(*lethal.T) < 1.5))
    assert np.mean(closed) <= 1.5, closed


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0])
def test_a_table_leg_stands_in_the_way_in_dust(dusty, distance):
    costmap, rng = dusty
    seen = []
    for scan in range(20):
        leg, off = dust(rng), rng.uniform(-0.5, 0.5)  # of a beam, by which the robot has turned
        for beam in range(-3, 4):
            if abs((beam + off) * math.pi / 180.0 * distance) <= 0.01:
                leg[AHEAD + beam] = distance + rng.normal(0.0, 0.01)
        lethal = see(costmap, leg, stamp=4.0 + 0.2 * scan)
        seen.append(any(lethal(distance + away, aside) for away in (-0.05, 0.0, 0.05) for aside in (-0.05, 0.0, 0.05)))
    assert seen.index(True) <= 5 and np.mean(seen) >= 0.4, seen


def test_a_foot_put_before_the_wheel_counts_at_once_in_dust(dusty):
    costmap, rng = dusty
    foot = {**dust(rng), **{AHEAD + beam: 1.0 for beam in range(-2, 3)}}
    assert see(costmap, foot, stamp=4.0)(1.0, 0.0)


def test_one_leg_counts_from_its_second_scan_on_again_once_the_dust_has_settled(dusty):
    costmap, _ = dusty
    for scan in range(REMEMBERED_IN_DUST):
        see(costmap, stamp=4.0 + 0.2 * scan)
    assert not see(costmap, {AHEAD: 1.0}, stamp=5.0)(1.0, 0.0)
    assert see(costmap, {AHEAD: 1.02}, stamp=5.2)(1.02, 0.0)


def plain_row(polar, bearing, distance, needed, like):
    """Return how many of the beams in a row hit what one of them does; `needed` where that cannot be told."""
    own, row = [other for other, _ in polar].index(bearing), 1
    for side in (1, -1):
        for away in range(1, needed + 2):
            other, reading = polar[(own + side * away) % len(polar)]
            if math.cos(other - bearing) <= 0.0 or abs(math.sin(other - bearing)) * distance > APART:
                return needed
            if reading >= distance + like:
                break
            row += 1 if needed == 2 or reading > distance - like else 0
            if row >= needed:
                return needed
        else:
            return needed
    return row


def plain(x, y, ends, marks, before, in_dust):
    """Return the marks that count, one after the other, and how many one beam hits and no other scan."""
    kept, alone = [], 0
    ends, marks, before = ends.tolist(), marks.tolist(), [scan.tolist() for scan in before]  # an array's rows are slow
    polar = sorted((math.atan2(end[1] - y, end[0] - x), math.hypot(end[0] - x, end[1] - y)) for end in ends)
    for mark in marks:
        bearing, distance = math.atan2(mark[1] - y, mark[0] - x), math.hypot(mark[0] - x, mark[1] - y)
        beside = polar[([other for other, _ in polar].index(bearing) + 1) % len(polar)][0]
        pitch, needed, like = abs(math.sin(beside - bearing)) * distance, 2, APART
        if in_dust:
            needed, like = min(1 + REMEMBERED_IN_DUST, max(3, math.ceil(THIN_IN_DUST / pitch))), LIKE_IN_DUST
        row = plain_row(polar, bearing, distance, needed, like)
        seen = sum(any(math.hypot(mark[0] - other[0], mark[1] - other[1]) < like for other in scan) for scan in before)
        if row + seen >= needed or not before:
            kept.append(mark)
        alone += bool(before) and row == 1 and seen == 0
    return np.array(kept).reshape(-1, 2), alone


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("seed", range(8))
def test_what_counts_is_what_a_plain_look_at_each_beam_says(seed, share):
    rng, lone, before, alone = np.random.default_rng(seed), LoneHits(), [], []
    for _ in range(7):
        x, y = rng.uniform(-1.0, 1.0, 2)
        bearings = np.sort(rng.uniform(-math.pi, math.pi, 120))
        ranges = np.where(rng.random(120) < share, rng.uniform(0.2, 3.0, 120), 2.5)
        ends = np.column_stack((x + ranges * np.cos(bearings), y + ranges * np.sin(bearings)))
        marks = ends[rng.random(120) < 0.8]
        in_dust = sum(alone[-REMEMBERED_IN_DUST:]) > DUSTY * 120 * len(alone[-REMEMBERED_IN_DUST:])
        remembered = REMEMBERED_IN_DUST if in_dust else REMEMBERED
        expected, lonely = plain(x, y, ends, marks, before[-remembered:], in_dust)
        assert np.array_equal(lone.without(x, y, ends, marks), expected)
        before, alone = before + [marks], alone + [lonely]
