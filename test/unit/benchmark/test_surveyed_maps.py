import numpy as np
from benchmark.map_gaps import Condition
from benchmark.surveyed_maps import make_surveyed_log

WHOLE = Condition(missing=0.0, range_max=8.0, step=1.0)


def test_a_survey_leaves_a_map_that_is_nearly_right_and_known_only_where_it_was():
    log, occupancy = make_surveyed_log("hall", 4200, WHOLE)
    assert {int(value) for value in np.unique(occupancy.data)} == {-1, 0, 100}
    assert log.ranges.shape == (len(log), 240) and 0.0 < np.isnan(log.ranges).mean() < 0.1
    cells = np.floor((log.reference[:, :2] - (occupancy.origin.x, occupancy.origin.y)) / occupancy.resolution)
    on_way = occupancy.data[cells[:, 1].astype(int), cells[:, 0].astype(int)]
    assert (on_way == 0).mean() > 0.95


def test_one_seed_makes_one_drive():
    first, second = (make_surveyed_log("office", 4200, WHOLE) for _ in range(2))
    np.testing.assert_array_equal(first[0].ranges, second[0].ranges)  # NaN is NaN
    assert np.array_equal(first[1].data, second[1].data)
