"""When a costmap is updated next, and that a robot need not wait for it longer than it must."""

import math

import pytest

from mbf_relay.costmap.freshness import Freshness, next_update
from mbf_relay.timing import SET_BACK


@pytest.mark.parametrize("frequency", [0.0, 0.001, 0.5])
def test_a_costmap_that_is_hardly_ever_updated_is_so_first_as_soon_as_there_is_a_pose(frequency):
    """Of one with 0.001 Hz, as public racing cars have it, the first try found no pose: it stood for 1000 s."""
    assert next_update(10.0, frequency, updates=0) == 11.0


@pytest.mark.parametrize("frequency, after", [(0.0, math.inf), (0.001, 1000.0), (0.5, 2.0), (10.0, 0.1)])
def test_a_costmap_keeps_to_its_rate_once_it_was_updated(frequency, after):
    assert next_update(10.0, frequency, updates=1) == 10.0 + after


def test_a_costmap_that_is_updated_often_is_tried_as_often_before():
    assert next_update(10.0, 10.0, updates=0) == pytest.approx(10.1)


@pytest.mark.parametrize("frequency, limit", [(50.0, 1.0), (5.0, 1.0), (2.0, 2.5), (0.5, 10.0), (0.0, 3.0)])
def test_a_robot_does_not_drive_on_by_a_costmap_that_is_not_updated_any_more(frequency, limit):
    """It may miss five updates, and one that is updated often a second's."""
    freshness = Freshness("local_costmap")
    freshness.note(10.0)
    assert freshness.trouble(10.0 + limit, frequency, resting=3.0) is None
    freshness.failure = "no transform"
    assert freshness.trouble(10.1 + limit, frequency, resting=3.0) == (
        f"local_costmap was last updated {limit + 0.1:.2f} s ago; at most {limit:.2f} s is allowed: no transform")
    freshness.note(10.1 + limit)
    assert freshness.trouble(10.1 + limit, frequency, resting=3.0) is None and freshness.updates == 2


def test_a_robot_whose_costmap_is_of_a_time_to_come_stands_and_the_reason_is_told_where_there_is_one():
    freshness = Freshness("local_costmap")
    assert freshness.trouble(10.0, 5.0, resting=3.0) == "local_costmap was not updated yet"
    freshness.failure = "no transform"
    assert freshness.never("no map") == "local_costmap was not updated yet: no map"
    assert freshness.never("") == freshness.trouble(10.0, 5.0, 3.0) == "local_costmap was not updated yet: no transform"
    freshness.note(10.0)
    assert freshness.trouble(10.0 - 0.9 * SET_BACK, 5.0, resting=3.0) is None
    assert freshness.trouble(9.9 - SET_BACK, 5.0, 3.0) == "local_costmap was last updated before time was set back"
