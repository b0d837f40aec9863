"""Occupancy maps and the files they are kept in (the map_server's form: a YAML file and an image)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbf_relay.geometry import Pose2D

FREE = 0
OCCUPIED = 100
UNKNOWN = -1


@dataclass(frozen=True)
class OccupancyMap:
    """A map of a floor.

    Attributes:
        data: Shape (height, width), int8: 0 free to 100 occupied, -1 unknown; row 0 is the lowest y.
        resolution: Side of a cell in metres.
        origin: Pose of the lower left corner in the map's frame; theta may turn the whole map.
    """

    data: np.ndarray
    resolution: float
    origin: Pose2D
