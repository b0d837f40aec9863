"""Which blocks of the map changed: told from where the robot surely is, and never from where it only thinks it is."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_room import room, scan_at

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.change_kernels import average_blocks, count_beams
from mbf_relay.localization.distance_field import OCCUPIED_FROM, DistanceField
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.stress import BLOCK, without_blocks
from mbf_relay.maps import OccupancyMap

START = Pose2D(1.5, 0.5, 0.3)
NARROW = np.diag([0.05, 0.05, 0.02]) ** 2


def drive(world, known, start=START, told=START, scans=30, **values):
    """Drive circles in a world with a filter on the map known; return the filter."""
    made = Localizer(LocalizerParameters(**values), known, np.random.default_rng(1))
    made.set_initial_pose(told, NARROW)
    truth, odom, rng = start, IDENTITY, np.random.default_rng(2)
    for _ in range(scans):
        made.process(odom, scan_at(world, truth, rng), IDENTITY)
        step = Pose2D(0.25, 0.0, 0.4)
        truth, odom = truth.compose(step), odom.compose(step)
    return made


def block_of(made, point):
    """Return what is told of the block that holds a point of the map's frame."""
    told = made.changed_blocks()
    local = Pose2D(*point, 0.0).relative_to(told.origin)
    return told.data[int(local.y / told.resolution), int(local.x / told.resolution)]


@pytest.mark.parametrize("origin", [Pose2D(-3.0, -2.0, 0.0), Pose2D(-3.0, -2.0, 0.6)])
@pytest.mark.parametrize("changed_block_size", [0.5, 1.0])
def test_a_map_that_is_as_it_was_has_no_changed_block(origin, changed_block_size):
    start = origin.compose(START.relative_to(Pose2D(-3.0, -2.0, 0.0)))
    made = drive(room(origin), room(origin), start, start, changed_block_size=changed_block_size)
    told = made.changed_blocks()
    assert not (told.data == 100).any()
    assert (told.data == 0).mean() > 0.5
    assert told.resolution == changed_block_size
    assert told.origin == origin


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_most_of_the_walls_a_map_lacks_are_told_and_few_others(seed):
    known = without_blocks(room(), 0.3, np.random.default_rng(seed))
    told = drive(room(), known).changed_blocks().data
    side = round(BLOCK / known.resolution) // 2

    def walls_in_blocks(cells):
        return cells.reshape(120 // side, side, 160 // side, side).sum(axis=(1, 3))

    walls = walls_in_blocks(room().data >= OCCUPIED_FROM)
    missing = walls - walls_in_blocks(known.data >= OCCUPIED_FROM)
    gone, same = (missing > 0.5 * walls) & (told >= 0), (missing == 0) & (told >= 0)
    assert gone.any()
    assert (told[gone] == 100).mean() > 0.7
    assert (told[same] == 100).mean() < 0.1


def test_a_wall_that_was_taken_away_has_changed():
    """Beams pass through it, and end on what stands behind."""
    world = room()
    world.data[40:60, 60:70] = 0
    made = drive(world, room(), changed_block_size=0.5)
    assert block_of(made, (0.3, 0.3)) == 100
    assert not (drive(world, world, changed_block_size=0.5).changed_blocks().data == 100).any()


def test_who_walked_by_is_forgotten():
    world = room()
    world.data[70:78, 70:78] = 100
    assert block_of(drive(world, room(), scans=8), (0.7, 1.7)) == 100
    made = Localizer(LocalizerParameters(), room(), np.random.default_rng(1))
    made.set_initial_pose(START, NARROW)
    truth, odom, rng = START, IDENTITY, np.random.default_rng(2)
    for index in range(50):
        made.process(odom, scan_at(world if index < 8 else room(), truth, rng), IDENTITY)
        truth, odom = truth.compose(Pose2D(0.25, 0.0, 0.4)), odom.compose(Pose2D(0.25, 0.0, 0.4))
    assert block_of(made, (0.7, 1.7)) == 0


@pytest.mark.parametrize("told", [Pose2D(-1.5, 2.5, 2.0), Pose2D(2.5, 1.3, 0.3), Pose2D(-1.0, 0.0, -1.5)])
def test_a_robot_in_the_wrong_place_does_not_mark_the_map_changed(told):
    made = Localizer(LocalizerParameters(), room(), np.random.default_rng(1))
    made.set_initial_pose(told, NARROW)
    truth, odom, rng = START, IDENTITY, np.random.default_rng(2)
    for _ in range(20):
        estimate = made.process(odom, scan_at(room(), truth, rng), IDENTITY)
        assert not (made.changed_blocks().data == 100).any(), estimate
        truth, odom = truth.compose(Pose2D(0.25, 0.0, 0.4)), odom.compose(Pose2D(0.25, 0.0, 0.4))


def test_what_was_counted_is_forgotten_where_the_filter_starts_anew():
    known = without_blocks(room(), 0.3, np.random.default_rng(1))
    made = drive(room(), known)
    assert (made.changed_blocks().data == 100).any()
    made.set_initial_pose(START, NARROW)
    assert (made.changed_blocks().data == -1).all()


def test_what_ends_in_unknown_space_has_not_changed():
    """The map does not say what is there."""
    data = room().data.copy()
    data[:, 120:] = -1
    told = drive(room(), replace(room(), data=data)).changed_blocks().data
    assert not (told[:, 7:] == 100).any()


def mean_error(world, known, semi_static):
    """Drive circles with odometry that is a little off; return the mean error (m) of the later half of the way."""
    parameters = LocalizerParameters(semi_static=semi_static, update_min_d=0.1)
    made = Localizer(parameters, known, np.random.default_rng(1))
    made.set_initial_pose(START, NARROW)
    truth, odom, rng, off = START, IDENTITY, np.random.default_rng(2), []
    for _ in range(40):
        off.append(made.process(odom, scan_at(world, truth, rng), IDENTITY).pose.distance_to(truth))
        truth, odom = truth.compose(Pose2D(0.25, 0.0, 0.4)), odom.compose(Pose2D(0.26, 0.0, 0.41))
    return float(np.mean(off[20:]))


@pytest.mark.parametrize("missing", [0.0, 0.3])
def test_a_semi_static_map_keeps_the_robot_as_near(missing):
    known = without_blocks(room(), missing, np.random.default_rng(3))
    assert mean_error(room(), known, True) < 1.3 * mean_error(room(), known, False) + 0.005


def test_shelves_that_were_moved_pull_no_more_on_a_semi_static_map():
    world = room()
    world.data[2:-2, -9:] = 100  # all along one wall, 0.35 m deep
    assert mean_error(world, room(), True) < 0.7 * mean_error(world, room(), False)


def counted(*beams):
    """Return what beams along a map's rows tell of its blocks of half a metre: like, unlike and free, (3, 4, 9).

    A wall a cell thick is where the lidar stands, one two cells thick at 3 m, unknown space from 4 m on. The map lies
    turned, and the lidar beside the robot's middle. Beams are y, and x of the end (m) on the map.
    """
    data, origin = np.zeros((20, 43), dtype=np.int8), Pose2D(1.0, 2.0, 0.7)
    data[:, 4] = data[:15, 30:32] = 100
    data[:, 40:] = -1
    field = DistanceField(OccupancyMap(data, 0.1, origin), 2.0)
    counts, touched, laser = np.zeros((3, 36), np.float32), np.empty(36, np.int64), Pose2D(0.2, -0.1, 0.0)
    for y, x in beams:
        base = origin.compose(Pose2D(0.45, y, 2.5)).compose(laser.inverse())
        end = base.inverse().transform_points(origin.transform_points(np.array([[x, y]])))
        one = np.zeros_like(counts)
        found = count_beams(
            np.array(base), np.ascontiguousarray(end), np.array(laser[:2]), field.occupancy.data, field.codes,
            (field.cell_distances == 0.0).astype(np.float32), field.cell_distances, field.frame, 0.3, 5, one, touched)
        assert sorted(touched[:found]) == np.flatnonzero(one.any(axis=0)).tolist()
        counts += one
    return counts.reshape(3, 4, 9).round(3)


def test_each_beam_tells_of_the_blocks_on_its_way_and_of_the_one_where_it_ends():
    like, unlike, free = counted((1.05, 3.05), (0.55, 3.65), (1.55, 4.15), (1.55, 0.45))
    for told, expected in (
        (like, {(2, 6): 1.0}), (unlike, {(1, 6): 1.0, (1, 7): 1.0}),
        (free, {(row, column): 1.0 for row, most in ((1, 6), (2, 6), (3, 8)) for column in range(1, most)}),
    ):
        assert {tuple(block): told[tuple(block)] for block in np.argwhere(told)} == expected


def test_a_block_is_told_by_its_beams_as_far_as_they_say_something_new():
    rng = np.random.default_rng(3)
    counts = (rng.integers(0, 5, (3, 60)) * (rng.random((3, 60)) < 0.5)).astype(np.float32)
    walled, seen, unlike = rng.random(60) < 0.5, rng.uniform(0.0, 4.0, 60), rng.random(60)
    touched, news = rng.permutation(60)[:50], 0.4
    told = counts[0] + counts[1]
    beams = np.where(told > 0.0, told, np.where(walled, 0.0, counts[2]))
    weights = np.where(np.isin(np.arange(60), touched), news * np.minimum(1.0, beams / 3.0), 0.0)
    expected_seen = np.minimum(seen + weights, 4.0)
    expected = unlike + weights / np.maximum(expected_seen, 1e-6) * (counts[1] / np.maximum(told, 1e-6) - unlike)
    left = np.where(np.isin(np.arange(60), touched), 0.0, counts)
    seen, unlike = seen.astype(np.float32), unlike.astype(np.float32)
    average_blocks(counts, touched, 50, walled, news, 3.0, 4.0, seen, unlike)
    assert seen == pytest.approx(expected_seen, abs=1e-5) and unlike == pytest.approx(expected, abs=1e-5)
    assert np.array_equal(counts, left)
