"""Filter for lidar hits of a single beam: keeps thin objects such as chair legs, drops rain, dust and stray light.

A hit counts if enough neighbouring beams, or scans shortly before, hit the same.
"""

from __future__ import annotations

from collections import deque
from typing import Deque, NamedTuple

import numpy as np

from mbf_relay.costmap import layer_kernels

APART = 0.1
"""Metres: hits nearer to each other may be of one object. A lone hit is one whose neighbouring beams pass it within
this distance and reach farther by at least as much.
"""
REMEMBERED = 2
"""Earlier scans that may confirm a lone hit in clear air; one suffices. One scan alone often misses a thin leg."""
DUSTY = 0.015
"""Share of unconfirmed lone hits among all beams above which the air counts as dusty. At that density one in sixty is
confirmed by chance, by a neighbour or an earlier scan; a room full of thin legs has a lower share.
"""
REMEMBERED_IN_DUST = 4
"""Earlier scans that may confirm a lone hit in dust; two of them must."""
LIKE_IN_DUST = 0.05
"""Metres between two hits of one object in dust: the noise of a lidar and of odometry. Within APART there often is
other dust, and right before a wall always some.
"""
THIN_IN_DUST = 0.025
"""Metres: in dust, an object of this width must be hit by as many neighbouring beams as fit on it. Near the lidar these
are many, while dust grains hit by neighbouring beams are few.
"""


class _Seen(NamedTuple):
    """An earlier scan: its marked hits, shape (M, 2) in metres, its number of beams, and of unconfirmed lone hits."""

    marks: np.ndarray
    beams: int
    alone: int


class LoneHits:
    """Removes hits from a lidar's scans that neither neighbouring beams nor earlier scans confirm.

    Two hits of an object are needed in clear air. In dust, where two may coincide by chance, three are needed, and near
    the lidar as many as there are beams on an object of THIN_IN_DUST.
    """

    def __init__(self) -> None:
        self._before: Deque[_Seen] = deque(maxlen=REMEMBERED_IN_DUST)

    @property
    def _in_dust(self) -> bool:
        return sum(seen.alone for seen in self._before) > DUSTY * sum(seen.beams for seen in self._before)

    def without(self, x: float, y: float, ends: np.ndarray, marks: np.ndarray) -> np.ndarray:
        """Take the next scan and return its confirmed hits, shape (K, 2) in metres.

        Args:
            x, y: Position (m) of the lidar, in the costmap's frame, as all points here.
            ends: Shape (N, 2) in metres: the ends of all beams in their order, hits or not.
            marks: Shape (M, 2) in metres: those of them that are to become obstacles, in the same order.
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
