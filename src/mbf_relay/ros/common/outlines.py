"""A robot's footprint from a message: one that takes up a load publishes another footprint."""

from __future__ import annotations

import numpy as np
from geometry_msgs.msg import Polygon

from mbf_relay.costmap.outline import MOST_CORNERS, parse_footprint
from mbf_relay.ros.common.checks import InvalidMessage, check_count


def outline_from_message(message: Polygon) -> np.ndarray:
    """Return a footprint without padding, shape (K, 2) in metres, base frame.

    Raises:
        ValueError: It has too few or too many corners, or is no valid footprint.
    """
    check_count(len(message.points), MOST_CORNERS, "corners")
    if not message.points:
        raise InvalidMessage("0 corners; a footprint must have at least 3")
    return parse_footprint([(point.x, point.y) for point in message.points])
