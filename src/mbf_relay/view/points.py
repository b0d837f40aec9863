"""Encodes points, poses and lines as 16-bit integers relative to an origin: a scan of 360 beams has 1.4 kB."""

from __future__ import annotations

from typing import Any, Dict

import numpy as np

from mbf_relay.view.batch import part

FINEST = 0.001
"""Least length (m) of one unit; finer is not visible."""
TURN_UNIT = 1e-4
"""Angle (rad) of one unit of heading, such that pi fits into 16 bits."""
LARGEST = 32767
"""Largest 16-bit integer."""


def points_part(layer: str, points: np.ndarray, limit: int, **more: Any) -> bytes:
    """Return points as a part.

    Args:
        layer: The layer's name.
        points: x, y (m), shape (N, 2), or with a heading (rad) in [-pi, pi], shape (N, 3); rows that are not finite are
            left out.
        limit: Largest number of points; more are thinned evenly.
        more: Further entries of the header.
    """
    points = np.asarray(points, dtype=float)
    points = thinned(points[np.isfinite(points).all(axis=1)], limit)
    header: Dict[str, Any] = {"layer": layer, "count": len(points), **more}
    if not len(points):
        return part(header)
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    origin = (low + high) / 2.0
    unit = max(FINEST, float(np.abs(high - origin).max()) / LARGEST)
    scaled = points.copy()
    scaled[:, :2] = (points[:, :2] - origin) / unit
    scaled[:, 2:] /= TURN_UNIT
    header.update(origin=[float(value) for value in origin.round(6)], unit=unit, columns=points.shape[1])
    return part(header, np.clip(np.rint(scaled), -LARGEST, LARGEST).astype("<i2").tobytes())


def thinned(points: np.ndarray, limit: int) -> np.ndarray:
    """Return at most `limit` rows, evenly chosen, with the first and the last."""
    if len(points) <= limit:
        return points
    chosen: np.ndarray = points[np.linspace(0, len(points) - 1, limit).round().astype(int)]
    return chosen
