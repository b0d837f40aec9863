"""What one beam alone hits: a thin leg, or a drop of rain or a ray of sunlight that the next scan knows nothing of."""

from __future__ import annotations

from collections import deque
from typing import Deque

import numpy as np

from mbf_relay.costmap import layer_kernels

APART = 0.1
"""Metres: what lies nearer to each other may be one thing. The beams beside a lone hit see that much farther than it,
and pass it no farther away.
"""
REMEMBERED = 2
"""Scans before this one that may have hit it, too: of two scans the second often passes a leg that the first met."""


class LoneHits:
    """Leaves out of a lidar's scans what one beam alone hits where the scans before hit nothing.

    Wider things are hit by several beams of one scan, and what is really there by another scan's.
    """

    def __init__(self) -> None:
        self._before: Deque[np.ndarray] = deque(maxlen=REMEMBERED)

    def without(self, x: float, y: float, ends: np.ndarray, marks: np.ndarray) -> np.ndarray:
        """Take the next scan and return those of its marks that count, shape (K, 2) in metres.

        Args:
            x, y: Where the lidar was (m), in the frame of all points here, which stands.
            ends: Shape (N, 2) in metres: where its beams ended, whether on something or not, in their order.
            marks: Shape (M, 2) in metres: those of them that become obstacles, in the same order.
        """
        counted, number = marks, len(marks)
        if self._before:
            counted = np.empty_like(marks)
            number = layer_kernels.without_lone(x, y, ends, marks, np.concatenate(self._before), APART, counted)
        self._before.append(marks)
        return counted[:number]
