import math
import tracemalloc

import numpy as np
import pytest
from synthetic_room import ORIGIN, room, scan_at

from mbf_relay.geometry import IDENTITY, Pose2D, angle_between
from mbf_relay.localization import scan_search
from mbf_relay.localization.beams import pick_beams
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.scan_likelihood import thin_out
from mbf_relay.localization.scan_search import BEAMS, TURNS, ScanSearch
from mbf_relay.localization.search_kernels import best_first, bound_all, bound_of
from mbf_relay.maps import OccupancyMap


def hits(occupancy, pose):
    return pick_beams(scan_at(occupancy, pose, np.random.default_rng(1)), IDENTITY, 1).hits


def is_near(pose, truth):
    return truth.distance_to(Pose2D(*pose)) < 0.25 and abs(angle_between(pose[2], truth.theta)) < 0.15


@pytest.mark.parametrize("origin", [ORIGIN, Pose2D(1.0, 2.0, 0.7)])
@pytest.mark.parametrize("place", [(1.5, 2.5, 0.3), (6.5, 4.0, -2.0), (4.0, 5.0, 3.1)])
def test_a_robot_switched_on_anywhere_is_found_by_its_first_scan(origin, place):
    occupancy = room(origin)
    truth = origin.compose(Pose2D(*place))
    found = ScanSearch(DistanceField(occupancy, 2.0)).search(hits(occupancy, truth))
    assert is_near(found.poses[0], truth)


def test_two_rooms_alike_are_both_found():
    one = room().data
    twins = OccupancyMap(np.hstack((one, one)), 0.05, ORIGIN)
    truth = ORIGIN.compose(Pose2D(1.5, 2.5, 0.3))
    twin = Pose2D(truth.x + 8.0, truth.y, truth.theta)
    found = ScanSearch(DistanceField(twins, 2.0)).search(hits(room(), truth))
    assert any(is_near(pose, truth) for pose in found.poses[:2])
    assert any(is_near(pose, twin) for pose in found.poses[:2])
    assert found.scores[1] == pytest.approx(found.scores[0], abs=0.1)


def test_of_two_rooms_nearly_alike_the_robots_own_comes_first():
    own, other = room().data, room().data.copy()
    other[:4, 60:80] = 0  # a metre of its wall is missing
    truth = ORIGIN.compose(Pose2D(1.5, 2.5, 0.3))
    for rooms, place in (((own, other), truth), ((other, own), Pose2D(truth.x + 8.0, truth.y, truth.theta))):
        twins = OccupancyMap(np.hstack(rooms), 0.05, ORIGIN)
        found = ScanSearch(DistanceField(twins, 2.0)).search(hits(room(), truth))
        assert is_near(found.poses[0], place) and found.scores[0] > found.scores[1] > 0.9


def test_nothing_to_see_is_found_nowhere():
    search = ScanSearch(DistanceField(room(), 2.0))
    assert len(search.search(np.empty((0, 2))).poses) == 0
    walls = OccupancyMap(np.full((40, 40), 100, dtype=np.int8), 0.05, ORIGIN)
    assert len(ScanSearch(DistanceField(walls, 2.0)).search(hits(room(), Pose2D(1.5, 0.5, 0.3))).poses) == 0


def test_no_block_holds_a_better_place_than_its_bound_says():
    """Else the search would leave the right place out."""
    search = ScanSearch(DistanceField(room(), 2.0))
    rng = np.random.default_rng(3)
    offsets = rng.integers(-60, 60, (1, 30, 2)).astype(np.int32)
    for level in (1, 2, 3, 4):
        for _ in range(20):
            row, column = rng.integers(0, 120 >> level), rng.integers(0, 160 >> level)
            below = [(2 * row + y, 2 * column + x) for y in (0, 1) for x in (0, 1)]
            inside = [(y, x) for y, x in below if y < 120 >> (level - 1) and x < 160 >> (level - 1)]
            whole, parts = np.empty(1, np.uint16), np.empty(len(inside), np.uint16)
            for at, blocks, bounds in ((level, [(row, column)], whole), (level - 1, inside, parts)):
                bound_all(at, np.array(blocks, dtype=np.int64), offsets, search._scores, search._levels, bounds)
            assert (parts <= whole[0]).all()


def test_a_row_of_blocks_is_bounded_as_each_block_is():
    search, rng = ScanSearch(DistanceField(room(), 2.0)), np.random.default_rng(5)
    offsets = rng.integers(-200, 200, (3, 30, 2)).astype(np.int32)  # many of them lead off the map
    level = search._top
    _, height, width = search._levels[level]
    blocks = np.ascontiguousarray(np.argwhere(rng.random((height, width)) < 0.6))
    bounds = np.empty(len(blocks) * 3, np.uint16)
    bound_all(level, blocks, offsets, search._scores, search._levels, bounds)
    for (row, column), found in zip(blocks, bounds.reshape(-1, 3)):
        single = [bound_of(level, row, column, turn, offsets, search._scores, search._levels, 0.0) for turn in range(3)]
        assert found.tolist() == single and max(single) > 0.0
        assert bound_of(level, row, column, 0, offsets, search._scores, search._levels, single[0]) == single[0]
        assert bound_of(level, row, column, 0, offsets, search._scores, search._levels, single[0] + 1.0) == 0.0


@pytest.mark.parametrize("wanted", [1, 40, 3000])
def test_the_best_bounds_come_first_and_no_others(wanted):
    bounds = np.random.default_rng(7).integers(0, 300, 3000).astype(np.uint16)
    order = np.empty(wanted, dtype=np.int64)
    best_first(bounds, order)
    assert order.tolist() == np.argsort(-bounds.astype(int), kind="stable")[:wanted].tolist()


def test_a_robot_on_a_large_map_is_looked_for_in_little_memory():
    """A hall of 200 m took a gigabyte, and with it the small computer that localized there."""
    free = np.zeros((480, 640), dtype=np.int8)
    free[:, 600:] = 100
    search = ScanSearch(DistanceField(OccupancyMap(free, 0.05, ORIGIN), 2.0))
    ends = np.column_stack((np.full(60, 2.0), np.linspace(-2.0, 2.0, 60)))
    tracemalloc.start()
    try:
        found = search.search(ends)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(found.poses) > 0 and most < 45 * (480 // 16) * (600 // 16) * TURNS


def test_a_large_map_is_prepared_in_little_memory():
    """What a map of 400 x 400 m is searched by took half a gigabyte for a moment, on a computer that may have one."""
    walls = np.zeros((2000, 2000), dtype=np.int8)
    walls[:, 0] = 100
    field = DistanceField(OccupancyMap(walls, 0.05, ORIGIN), 2.0)
    tracemalloc.start()
    try:
        ScanSearch(field)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 6.5 * walls.nbytes


def test_a_search_that_ends_early_tells_how_much_it_left_out(monkeypatch):
    """A robot on a large map was told to be where it is not, and nobody that most of the map had not been looked at."""
    search, scan = ScanSearch(DistanceField(room(), 2.0)), hits(room(), Pose2D(-1.5, 0.5, 0.3))
    assert search.search(scan, margin=0.5).searched == 1.0
    monkeypatch.setattr(scan_search, "MOST_VISITS", 50)
    assert 0.0 < search.search(scan, margin=0.5).searched < 0.5


def test_every_heading_is_tried():
    occupancy = room()
    search = ScanSearch(DistanceField(occupancy, 2.0))
    for heading in np.linspace(-math.pi, math.pi, 7):
        truth = Pose2D(1.5, 0.5, float(heading))
        assert is_near(search.search(hits(occupancy, truth)).poses[0], truth)


@pytest.mark.parametrize("place", [(1.5, 2.5, 0.3), (6.5, 4.0, -2.0)])
def test_a_robot_is_told_the_best_place_of_all_that_there_are(place):
    """Beside a look at every place: the blocks that are left out hold no better one, nor do those looked at."""
    occupancy = room()
    search, scan = ScanSearch(DistanceField(occupancy, 2.0)), hits(occupancy, ORIGIN.compose(Pose2D(*place)))
    ends, headings = thin_out(scan, BEAMS), np.arange(TURNS) * (2.0 * math.pi / TURNS)
    blocks = np.ascontiguousarray(np.argwhere(search._level(search._free, search._leaf)[1:, 1:]))
    bounds = np.empty(len(blocks) * TURNS, np.uint16)
    bound_all(search._leaf, blocks, search._offsets(ends, headings), search._scores, search._levels, bounds)
    found = search.search(scan)
    assert found.scores[0] * 255.0 * len(ends) == pytest.approx(bounds.max())
    side = occupancy.resolution * 2 ** search._leaf
    best = [
        ORIGIN.compose(Pose2D((column + 0.5) * side, (row + 0.5) * side, headings[index % TURNS]))
        for index in np.flatnonzero(bounds == bounds.max()) for row, column in [blocks[index // TURNS]]]
    assert any(pose.distance_to(Pose2D(*found.poses[0])) < 1e-6 for pose in best)


def test_a_robot_is_not_told_to_stand_where_the_map_knows_nothing():
    occupancy, truth = room(), ORIGIN.compose(Pose2D(2.0, 2.8, 0.3))
    known, scan = ScanSearch(DistanceField(room(), 2.0)), hits(room(), truth)
    occupancy.data[52:60, 36:44] = -1
    found = ScanSearch(DistanceField(occupancy, 2.0)).search(scan)
    columns, rows = np.floor(ORIGIN.inverse().transform_points(found.poses[:, :2]) / 0.05).astype(int).T
    assert len(found.poses) and (occupancy.data[rows, columns] == 0).all()
    assert is_near(known.search(scan).poses[0], truth)
