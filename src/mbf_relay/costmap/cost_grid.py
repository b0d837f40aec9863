"""What planners and controllers see of a costmap: one consistent picture of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from mbf_relay.costmap.window import EMPTY, Window
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
        revision: Grows with every change of `costs` and is never used twice, so that equal revisions are equal pictures;
            0 for a picture that no costmap made.
        stamp: Time (s) of the update it shows.
        history: The latest changes, oldest first: the revision each led to, and the cells it touched.
    """

    grid: Grid
    costs: np.ndarray
    frame: str
    footprint: np.ndarray
    inscribed_radius: float
    circumscribed_radius: float
    revision: int = 0
    stamp: float = 0.0
    history: Tuple[Tuple[int, Window], ...] = ()

    @property
    def half_width(self) -> float:
        """How far (m) the footprint reaches to the sides of a robot that drives ahead; a round robot has none drawn."""
        return float(np.abs(self.footprint[:, 1]).max()) if len(self.footprint) else self.inscribed_radius

    def changed_since(self, revision: int) -> Optional[Window]:
        """Return a window that holds all that changed since an earlier picture, or None where that is not known."""
        changed = EMPTY
        for later, window in reversed(self.history):
            if later == revision:
                return changed
            changed = changed.union(window)
        return None
