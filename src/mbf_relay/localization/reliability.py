"""Reliability: the probability that the pose told is right within RIGHT_WITHIN and RIGHT_TURN (compare als_ros).

A logistic regression on how the last few metres' scans fitted at the pose held, times the share of the belief that the
rivals leave it. Its weights were fitted on synthetic drives through corridors and a hall; README.md has how well they
do on drives through other buildings.
"""

from __future__ import annotations

import math

RIGHT_WITHIN, RIGHT_TURN = 0.5, math.pi / 18.0
"""Error (m, rad) up to which a pose counts as right."""
REMEMBERED = 2.0
"""Way (m) over which the fit of scans is averaged."""
CONSTANT, HITS, THROUGH = -2.7, 7.2, -60.0
"""Of the regression: log-odds of a pose with nothing known, and for the share of hits and of beams through walls. The
last is set by hand: a made map is so exact that a fit would take one beam through a wall for proof."""

UNSEEN = 0.5
"""Probability that a place is the right one before any scan was seen from it: that of a user's word, or a rival's."""


class Reliability:
    """Follows how scans fit at the pose held.

    Attributes:
        hits: Share of the beams that hit what the map has, averaged over the last metres.
        through: Share of the beams that passed through what the map has, likewise.
    """

    def __init__(self) -> None:
        self.hits, self.through, self._way = 0.0, 0.0, 0.0

    def look(self, hits: float, through: float, way: float) -> None:
        """Take the shares of one scan and the way (m) to it."""
        share = max(0.05, way / (min(self._way, REMEMBERED) + way)) if self._way > 0.0 else 1.0
        self.hits += share * (hits - self.hits)
        self.through += share * (through - self.through)
        self._way += max(way, 1e-3)

    def value(self, share_held: float, deviation: float) -> float:
        """Return the probability that the pose is right; where no scan has told yet, as UNSEEN and the spread have it.

        Args:
            share_held: Share of the belief in the hypothesis the pose is from, 0 to 1.
            deviation: Of its position (m), of one axis.
        """
        within = -math.expm1(-0.5 * (RIGHT_WITHIN / max(deviation, 1e-3)) ** 2)
        if self._way == 0.0:
            return share_held * within * UNSEEN
        odds = CONSTANT + HITS * self.hits + THROUGH * self.through
        return share_held * within / (1.0 + math.exp(-odds))
