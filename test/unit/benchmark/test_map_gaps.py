"""Drives over maps with gaps: one way however often the robot looks, and maps that lack what they shall."""

import numpy as np
import pytest
from benchmark.map_gaps import CONDITIONS, JUDGED_ON, TUNED_ON, Condition, make_log, make_way, share_right

DENSE, SPARSE = Condition(0.3, 3.5, 0.2), Condition(0.3, 3.5, 1.0)
SEED = TUNED_ON
"""Of those that may be looked at."""


def test_the_robot_goes_the_same_way_however_often_it_looks():
    (dense, dense_map), (sparse, sparse_map) = (make_log("alcoves", SEED, condition) for condition in (DENSE, SPARSE))
    assert np.array_equal(dense_map.data, sparse_map.data)
    assert len(dense) > 4 * len(sparse) > 100
    places = {tuple(pose) for pose in make_way("alcoves", SEED)[1].truth}
    assert {tuple(pose) for pose in sparse.reference} <= places
    for log in (dense, sparse):
        by_place = {tuple(true): tuple(odom) for true, odom in zip(log.reference, log.odom)}
        way = make_way("alcoves", SEED)[1]
        assert by_place.items() <= dict(zip(map(tuple, way.truth), map(tuple, way.odom))).items()


def test_blocks_are_missing_from_the_map_and_not_from_what_the_lidar_sees():
    log, lacking = make_log("hall", SEED, SPARSE)
    seen, whole = make_log("hall", SEED, SPARSE._replace(missing=0.0))
    assert np.array_equal(log.ranges, seen.ranges)
    assert 0.5 < (lacking.data > 0).sum() / (whole.data > 0).sum() < 0.9


@pytest.mark.parametrize("robust", [False, True])
def test_a_drive_through_a_whole_building_is_kept(robust):
    assert share_right("alike", SEED, Condition(0.0, 8.0, 0.2), robust) > 0.9


def test_tuned_and_judged_seeds_and_conditions_are_apart():
    assert JUDGED_ON >= TUNED_ON + 100
    assert len(set(CONDITIONS)) == len(CONDITIONS) == 12
