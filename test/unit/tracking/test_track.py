"""A track, where it will be and as seen from another frame."""

import math

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.tracking.track import Track, as_array

WALKER = Track(7, 3.0, 1.0, -0.5, 0.3, -0.2, 0.15, 0.01, -0.004, 0.02)


@pytest.mark.parametrize("ahead", [0.0, 0.4, 2.5, -0.3])
def test_where_somebody_will_be_is_as_sure_as_a_kalman_filter_says(ahead):
    step = np.array([[1.0, ahead], [0.0, 1.0]])
    (position, both), (_, velocity) = step @ np.array([[0.01, -0.004], [-0.004, 0.02]]) @ step.T
    later = WALKER.at(3.0 + ahead)
    assert (later.x, later.y) == pytest.approx((1.0 + 0.3 * ahead, -0.5 - 0.2 * ahead))
    assert (later.position_variance, later.covariance, later.velocity_variance) == pytest.approx(
        (position, both, velocity))
    assert (later.number, later.stamp, later.vx, later.vy, later.radius) == (7, 3.0 + ahead, 0.3, -0.2, 0.15)
    assert as_array((WALKER, WALKER), 3.0 + ahead) == pytest.approx(np.array([later[2:]] * 2))


def test_nobody_s_place_has_a_variance_below_zero():
    assert WALKER._replace(covariance=-1.0).at(3.1).position_variance == 0.0
    assert as_array((), 1.0).shape == (0, 8)


def test_a_track_is_seen_from_a_frame_that_lies_elsewhere_and_is_turned():
    """Its place goes along with where the frame lies, its velocity but with how it is turned."""
    seen = WALKER.seen_from(Pose2D(2.0, 3.0, math.pi / 2.0))
    assert (seen.x, seen.y, seen.vx, seen.vy) == pytest.approx((2.5, 4.0, 0.2, 0.3))
    assert seen == WALKER._replace(x=seen.x, y=seen.y, vx=seen.vx, vy=seen.vy)
    assert seen.speed == pytest.approx(WALKER.speed)
