"""What planners and controllers see of a costmap: one consistent picture of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mbf_relay.grid import Grid

FREE_SPACE = 0
INSCRIBED = 253  # the robot's centre here means its inscribed circle touches an obstacle
LETHAL = 254
NO_INFORMATION = 255


@dataclass(frozen=True)
class CostGrid:
    """A snapshot of a costmap; whoever holds it may rely on it not to change. Treat as read-only.

    Attributes:
        grid: Where the cells lie in `frame`.
        costs: Shape (height, width), uint8, C-contiguous: 0 free to 252, then INSCRIBED, LETHAL, NO_INFORMATION.
        frame: Frame of the grid ("map" or "odom").
        footprint: Outline of the robot around its base frame, shape (K, 2) in metres, padding included.
        inscribed_radius: Largest circle (m) around the base within the footprint.
        circumscribed_radius: Smallest circle (m) around the base that holds the footprint.
        revision: Grows with every change of `costs`, so equal revisions of one costmap are equal pictures.
        stamp: Time (s) of the update it shows.
    """

    grid: Grid
    costs: np.ndarray
    frame: str
    footprint: np.ndarray
    inscribed_radius: float
    circumscribed_radius: float
    revision: int = 0
    stamp: float = 0.0
