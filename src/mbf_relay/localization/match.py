"""How well a scan fits the map from one pose: a figure for people, which the filter itself does not use."""

from __future__ import annotations

from typing import Optional

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import DistanceField

ON_A_WALL = 0.1
"""Metres from the nearest occupied cell's centre within which a reading's end fits the map."""


def share_on_map(field: DistanceField, pose: Pose2D, endpoints: np.ndarray) -> Optional[float]:
    """Return which share of a scan's ends the map explains, 0 to 1; None where the scan has no end.

    Args:
        field: The map.
        pose: Of the base, in the map's frame.
        endpoints: Shape (H, 2) in metres, in the base's frame.
    """
    if len(endpoints) == 0:
        return None
    points = pose.relative_to(field.origin).transform_points(endpoints)
    columns, rows = np.floor(points / field.resolution).astype(np.int64).T
    height, width = field.distances.shape
    on_map = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    near = field.distances[rows[on_map], columns[on_map]] <= max(ON_A_WALL, field.resolution)
    return float(np.count_nonzero(near)) / len(endpoints)
