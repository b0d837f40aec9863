"""Readings of sonars, taken as what they say and refused where they say nothing."""

import math

import numpy as np
import pytest
from sensor_msgs.msg import Range

from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.range_readings import range_points

INF, NAN = math.inf, math.nan


def reading(value, least=0.2, most=3.0, width=0.4):
    return Range(range=value, min_range=least, max_range=most, field_of_view=width)


@pytest.mark.parametrize("message, far_is_free, distance, hit", [
    (reading(1.5), False, 1.5, True), (reading(3.0), True, 3.0, False), (reading(INF), True, 3.0, False),
    (reading(7.0), True, 3.0, False), (reading(-INF, 0.8, 0.8), False, 0.8, True),
    (reading(INF, 0.8, 0.8), True, 0.8, False),
])
def test_a_robot_is_told_what_its_sonar_sees(message, far_is_free, distance, hit):
    points, hits = range_points(message, far_is_free)
    angles = [-0.2, 0.0, 0.2]
    np.testing.assert_allclose(points, distance * np.column_stack((np.cos(angles), np.sin(angles))), rtol=1e-6)
    assert hits.tolist() == [hit] * 3


@pytest.mark.parametrize("message", [
    reading(3.0), reading(INF), reading(0.1), reading(-INF), reading(INF, 0.8, 0.8), reading(-1.0)])
def test_what_a_sonar_says_that_measured_nothing_stands_in_nobodys_way(message):
    points, hits = range_points(message, False)
    assert points.shape == (0, 2) and hits.shape == (0,)


@pytest.mark.parametrize("message, words", [
    (reading(NAN), "its range is not a number"), (reading(1.0, width=0.0), "its field_of_view is 0 rad"),
    (reading(1.0, width=NAN), "field_of_view is nan"), (reading(1.0, width=7.0), "field_of_view is 7 rad"),
    (reading(1.0, least=2.0, most=1.0), "its ranges are 2 to 1 m"), (reading(1.0, most=INF), "0.2 to inf m"),
    (reading(1.0, least=-1.0), "its ranges are -1 to 3 m"), (reading(0.5, 0.8, 0.8), "says -inf where something"),
    (reading(1.0, least=0.0, most=0.0), "its ranges are 0 to 0 m"),
])
def test_nonsense_is_refused_by_what_is_wrong_with_it(message, words):
    with pytest.raises(InvalidMessage, match=words):
        range_points(message, True)
