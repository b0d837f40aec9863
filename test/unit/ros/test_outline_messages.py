"""Footprints that come by topic."""

import pytest
from geometry_msgs.msg import Point32, Polygon

from mbf_relay.costmap.outline import check_padded
from mbf_relay.ros.common.outlines import outline_from_message


@pytest.mark.parametrize("corners, said", [
    ([], "0 corners"),
    ([(0.0, 0.0), (1.0, 0.0)], "at least 3"),
    ([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)], "encloses no area"),
    ([(3.0, 3.0), (4.0, 3.0), (4.0, 4.0)], "does not hold the base frame's origin"),
    ([(0.0, float("nan")), (1.0, 0.0), (2.0, 0.0)], "must be finite"),
    ([(0.0, 0.0)] * 1001, "at most 1000"),
    ([(25.0, 25.0), (-25.0, 25.0), (0.0, -25.0)], "reaches 35.36 m from the base frame, 707 cells"),
])
def test_no_message_makes_the_robot_a_point_or_a_line(corners, said):
    """One without corners made the robot a point, which fits between any two things."""
    with pytest.raises(ValueError, match=said):
        check_padded(outline_from_message(Polygon([Point32(x, y, 0.0) for x, y in corners])), 0.0, 0.05)


def test_an_outline_comes_through():
    message = Polygon([Point32(0.5, 0.0, 0.0), Point32(-0.5, 0.25, 0.0), Point32(-0.5, -0.25, 0.0)])
    assert outline_from_message(message).tolist() == [[0.5, 0.0], [-0.5, 0.25], [-0.5, -0.25]]
