"""sensor_msgs/Range of sonars and infrared rangers, as points in the sensor's frame."""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np
from sensor_msgs.msg import Range

from mbf_relay.ros.common.checks import InvalidMessage

WIDEST = math.pi
"""Largest field_of_view (rad)."""


def range_points(message: Range, far_is_free: bool) -> Tuple[np.ndarray, np.ndarray]:
    """Return the end of a reading's cone, and whether an obstacle is there.

    Args:
        message: The reading. min_range equal to max_range marks a sensor of fixed distance, which only tells whether
            something is nearer than that, by -inf, or not, by +inf (REP 117).
        far_is_free: Whether a reading of max_range or more means that the cone is free (clear_on_max_reading).

    Returns:
        The end points of the cone's right edge, axis and left edge, shape (3, 2) in metres, and whether they are hits,
        (3,) bool; both empty where the reading has no information.

    Raises:
        InvalidMessage: A number is invalid; the text names it.
    """
    least, most, reading, width = message.min_range, message.max_range, message.range, message.field_of_view
    if not (math.isfinite(width) and 0.0 < width <= WIDEST):
        raise InvalidMessage(f"its field_of_view is {width:.6g} rad; it must be above 0 and at most {WIDEST:.6g}")
    if not (math.isfinite(least) and math.isfinite(most) and 0.0 <= least <= most and most > 0.0):
        raise InvalidMessage(f"its ranges are {least:.6g} to {most:.6g} m; they must be finite, in order, not below 0")
    if math.isnan(reading):
        raise InvalidMessage("its range is not a number (NaN)")
    if least == most and math.isfinite(reading):
        raise InvalidMessage(
            f"its range is {reading:.6g} m, and its min_range its max_range: such a ranger says -inf where something "
            "is nearer than that, and inf where nothing is")
    hit = reading == -math.inf if least == most else least <= reading < most
    if not hit and not (far_is_free and reading >= most):
        return np.zeros((0, 2)), np.zeros(0, dtype=bool)
    distance = reading if hit and least < most else most
    angles = 0.5 * width * np.array([-1.0, 0.0, 1.0])
    return distance * np.column_stack((np.cos(angles), np.sin(angles))), np.full(3, hit)
