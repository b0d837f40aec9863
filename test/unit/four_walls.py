"""A room of four walls, and what a lidar in it reads, to be reckoned by hand."""

import numpy as np

WALLS = np.array([-2.0, 3.0, -1.5, 2.5])
"""Left and right, and lower and upper end (m)."""


def seen_from(x, y, directions):
    """Return the distances (m) to the walls in some directions (rad) from x and y (m); all of one shape, or scalars."""
    cos, sin = np.cos(directions), np.sin(directions)
    to_sides = np.abs(np.where(cos > 0.0, WALLS[1], WALLS[0]) - x) / np.maximum(np.abs(cos), 1e-9)
    to_ends = np.abs(np.where(sin > 0.0, WALLS[3], WALLS[2]) - y) / np.maximum(np.abs(sin), 1e-9)
    return np.minimum(to_sides, to_ends)
