"""What one beam alone hits: a thin leg, or a drop of rain or a ray of sunlight that the next scan knows nothing of."""

from __future__ import annotations

from collections import deque
from typing import Deque, NamedTuple

import numpy as np

from mbf_relay.costmap import layer_kernels

APART = 0.1
"""Metres: what lies nearer to each other may be one thing. The beams beside a lone hit see that much farther than it,
and pass it no farther away.
"""
REMEMBERED = 2
"""Scans before this one that may have hit it, too: of two scans the second often passes a leg that the first met."""
DUSTY = 0.015
"""Share of the beams that hit what none beside them hits and no scan before, from which on the air is full of it. One
of them in sixty also lies beside another by chance, or where another was; a room full of thin legs has fewer.
"""
REMEMBERED_IN_DUST = 4
"""Scans that may have hit the same there: two of them at least make an obstacle of a lone hit, in clear air one of two.
"""
LIKE_IN_DUST = 0.05
"""Metres: as far as a lidar's noise and odometry part two hits of one leg; within APART there is other dust, and before
every wall.
"""
THIN_IN_DUST = 0.025
"""Metres: what is as wide is hit by enough beams of one scan. Near the lidar they lie close, and dust lies by dust."""


class _Seen(NamedTuple):
    """What became obstacles of a scan of so many beams, shape (M, 2) in metres, and how many hit what no other did."""

    marks: np.ndarray
    beams: int
    alone: int


class LoneHits:
    """Leaves out of a lidar's scans what one beam alone hits where the scans before hit nothing.

    Wider things are hit by several beams of one scan, and what is really there by another scan's: by two hits in clear
    air; where dust, that is everywhere, hits twice by chance, by three, and near the lidar by as many as would hit what
    is not thin.
    """

    def __init__(self) -> None:
        self._before: Deque[_Seen] = deque(maxlen=REMEMBERED_IN_DUST)

    @property
    def _in_dust(self) -> bool:
        return sum(seen.alone for seen in self._before) > DUSTY * sum(seen.beams for seen in self._before)

    def without(self, x: float, y: float, ends: np.ndarray, marks: np.ndarray) -> np.ndarray:
        """Take the next scan and return those of its marks that count, shape (K, 2) in metres.

        Args:
            x, y: Where the lidar was (m), in the frame of all points here, which stands.
            ends: Shape (N, 2) in metres: where its beams ended, whether on something or not, in their order.
            marks: Shape (M, 2) in metres: those of them that become obstacles, in the same order.
        """
        counted, number, alone = marks, len(marks), 0
        if self._before:
            like, thin, fewest, remembered = APART, 0.0, 2, REMEMBERED
            if self._in_dust:
                like, thin, fewest, remembered = LIKE_IN_DUST, THIN_IN_DUST, 3, REMEMBERED_IN_DUST
            before = [seen.marks for seen in self._before][-remembered:]
            counted = np.empty_like(marks)
            number, alone = layer_kernels.without_lone(
                x, y, ends, marks, np.concatenate(before), np.cumsum([len(one) for one in before]), APART, like, thin,
                fewest, 1 + remembered, counted)
        self._before.append(_Seen(marks, len(ends), alone))
        return counted[:number]
