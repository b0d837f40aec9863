"""Reliability: the probability that the pose told is right within RIGHT_WITHIN and RIGHT_TURN (compare als_ros).

A Bayes filter over two states, the pose held is right or wrong: by every metre a right one may go wrong and a wrong one
right, and every scan is evidence for either by how it fits there. A wrong pose fits well for metres at a time, along a
corridor like the right one; what spoke against it before that still counts, until another hypothesis takes over. Its
numbers were fitted on made drives; README.md has how well they do on others. What rivals leave of it is `Hypotheses`'.
"""

from __future__ import annotations

import math

RIGHT_WITHIN, RIGHT_TURN = 0.5, math.pi / 18.0
"""Error (m, rad) up to which a pose counts as right."""
REMEMBERED = 2.0
"""Way (m) over which hits are averaged for those who ask how scans fit of late."""
CONSTANT, HITS, THROUGH = -0.25, 0.92, -39.0
"""Log-odds that a metre's scans add: in any case, for the share of hits, and for that of beams through walls."""
FIRST = 3.0
"""Metres that the first scan counts as: it hits no wall that an earlier one hit."""
LEAST = 0.02
"""Metres that any scan counts as, such as one of a robot that stands: almost nothing, it is the same again."""
GOES_WRONG, COMES_RIGHT = 0.010, 0.013
"""Chance by the metre that a right pose goes wrong, and that a wrong one becomes right without being given up."""

MOST = 14.0
"""Log-odds beyond which nothing is surer."""
UNSEEN, CHOSEN = 0.5, 0.2
"""Probability that a pose is right at first: a user's word before any scan, and a rival that comes up."""


class Reliability:
    """Follows how scans fit at the pose held.

    Attributes:
        hits: Share of the beams that hit what the map has, averaged over the last metres.
        right: Probability that the pose is right, rivals and spread aside.
    """

    def __init__(self, chosen: bool = False) -> None:
        """Begin with a pose that a user gave, or with one chosen because scans fit there: that they do says no more."""
        self.hits, self._way = 0.0, 0.0
        self.right = CHOSEN if chosen else UNSEEN
        self._first = 0.0 if chosen else FIRST

    def look(self, hits: float, through: float, way: float) -> None:
        """Take the shares of one scan and the way (m) to it."""
        share = 1.0 if self._way == 0.0 else max(0.05, way / (min(self._way, REMEMBERED) + way))
        self.hits += share * (hits - self.hits)
        self._way += max(way, 1e-3)
        in_the_end = COMES_RIGHT / (GOES_WRONG + COMES_RIGHT)
        right = in_the_end + (self.right - in_the_end) * math.exp(-(GOES_WRONG + COMES_RIGHT) * way)
        evidence = CONSTANT + HITS * hits + THROUGH * through
        odds = math.log(right / (1.0 - right)) + evidence * (self._first or min(1.0, max(LEAST, way)))
        self._first = 0.0
        self.right = 1.0 / (1.0 + math.exp(-min(MOST, max(-MOST, odds))))


def within(deviation: float) -> float:
    """Return the probability that a position with this deviation (m), of one axis, errs by less than RIGHT_WITHIN."""
    return -math.expm1(-0.5 * (RIGHT_WITHIN / max(deviation, 1e-3)) ** 2)
