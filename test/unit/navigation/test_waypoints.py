"""Which waypoint is next: once, in loops, with waits, and where one is not reached."""

import math

import pytest

from mbf_relay.navigation.waypoints import WaypointFollower


def driven(follower, reached=lambda index: True, period=1.0):
    """Drive until it is over; return the waypoints in order, with the time of each."""
    now, way = 0.0, []
    while not follower.is_over:
        index = follower.next_waypoint(now)
        now += period
        if index is not None:
            way.append((index, now - period))
            follower.ended(now, reached(index))
        assert now < 1000.0
    return way


def test_each_is_driven_to_once_and_then_it_is_over():
    follower = WaypointFollower(3)
    assert [index for index, _ in driven(follower)] == [0, 1, 2]
    assert follower.missed == [] and not follower.has_failed and follower.next_waypoint(1e9) is None


def test_loops_begin_with_the_first_whichever_was_begun_with():
    follower = WaypointFollower(3, loops=2, first=1)
    assert [index for index, _ in driven(follower)] == [1, 2, 0, 1, 2, 0, 1, 2]
    assert follower.loop == 2


def test_the_robot_stands_at_each_that_it_reached_but_not_after_the_last():
    follower = WaypointFollower(3, pause=5.0)
    way = driven(follower, lambda index: index != 1)
    assert way == [(0, 0.0), (1, 6.0), (2, 7.0)]


def test_a_robot_whose_clock_is_set_back_while_it_stands_goes_on_after_the_wait():
    """It stood until the clock was there again, an hour later, and its client heard nothing."""
    follower = WaypointFollower(2, pause=5.0)
    follower.ended(3600.0, reached=follower.next_waypoint(3600.0) == 0)
    assert follower.next_waypoint(1.0) is None and follower.next_waypoint(5.0) is None
    assert follower.next_waypoint(6.0) == 1


def test_one_that_is_not_reached_is_left_out():
    follower = WaypointFollower(3, loops=1)
    assert len(driven(follower, lambda index: index != 1)) == 6
    assert follower.missed == [1, 1] and not follower.has_failed


def test_one_that_is_not_reached_ends_it_where_that_is_wanted():
    follower = WaypointFollower(3, loops=1, stops=True)
    assert [index for index, _ in driven(follower, lambda index: index != 1)] == [0, 1]
    assert follower.missed == [1] and follower.has_failed


@pytest.mark.parametrize("arguments, text", [
    (dict(count=0), "no poses"), (dict(count=2, first=2), "goal_index is 2"), (dict(count=2, pause=-1.0), "-1"),
    (dict(count=2, pause=math.nan), "nan"), (dict(count=2, pause=math.inf), "inf"),
])
def test_what_cannot_be_followed_is_refused_with_its_value(arguments, text):
    with pytest.raises(ValueError, match=text):
        WaypointFollower(**arguments)
