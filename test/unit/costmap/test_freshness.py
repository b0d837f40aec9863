"""When a costmap is updated next, and that a robot need not wait for it longer than it must."""

import math

import pytest

from mbf_relay.costmap.freshness import next_update


@pytest.mark.parametrize("frequency", [0.0, 0.001, 0.5])
def test_a_costmap_that_is_hardly_ever_updated_is_so_first_as_soon_as_there_is_a_pose(frequency):
    """Of one with 0.001 Hz, as public racing cars have it, the first try found no pose: it stood for 1000 s."""
    assert next_update(10.0, frequency, updates=0) == 11.0


@pytest.mark.parametrize("frequency, after", [(0.0, math.inf), (0.001, 1000.0), (0.5, 2.0), (10.0, 0.1)])
def test_a_costmap_keeps_to_its_rate_once_it_was_updated(frequency, after):
    assert next_update(10.0, frequency, updates=1) == 10.0 + after


def test_a_costmap_that_is_updated_often_is_tried_as_often_before():
    assert next_update(10.0, 10.0, updates=0) == pytest.approx(10.1)
