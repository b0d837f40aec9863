import math

import numpy as np
import pytest

from mbf_relay.scan import LaserScan


def made(ranges, first, step):
    return LaserScan(np.array(ranges, dtype=float), first, step, 0.1, 30.0, 0.0)


@pytest.mark.parametrize("beams", [1, 2, 270, 359, 360, 361])
@pytest.mark.parametrize(("first", "sign"), [(0.0, 1.0), (-math.pi, 1.0), (math.pi, -1.0), (3.0, -1.0), (4.0, 1.0)])
def test_each_beam_is_found_again_in_its_own_direction(beams, first, sign):
    scan = made(np.arange(beams), first, sign * math.radians(1.0))
    around = slice(None, min(beams, 360))
    assert (scan.readings_at(scan.angles)[around] == scan.ranges[around]).all()
    assert (scan.readings_at(scan.angles + 2.0 * math.pi)[around] == scan.ranges[around]).all()


def test_where_no_beam_looks_there_is_no_reading():
    read = made([1.0, 2.0, 3.0], -0.1, 0.1).readings_at(np.array([-0.2, -0.14, -0.06, 0.04, 0.06, 0.14, 0.16, math.pi]))
    np.testing.assert_equal(read, [math.nan, 1.0, 1.0, 2.0, 3.0, 3.0, math.nan, math.nan])


def test_a_turn_with_a_beam_less_than_it_has_room_for_has_no_hole():
    step = 2.0 * math.pi / 360.0
    assert (made(np.ones(359), 0.0, step).readings_at(np.linspace(0.0, 2.0 * math.pi, 1000)) == 1.0).all()
