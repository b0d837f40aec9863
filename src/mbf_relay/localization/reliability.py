"""Reliability: the probability that the estimate is right within RIGHT_WITHIN and RIGHT_TURN (compare als_ros).

A Bayes filter over two states, held pose right or wrong. Per metre a right one may go wrong and a wrong one come right,
and each scan is evidence by how well it fits. A wrong pose may fit well for metres, in a corridor like the right one;
earlier evidence against it still counts, until another hypothesis takes over. The constants were fitted on simulated
drives; README.md has results on others. `Hypotheses.reliability` accounts for rivals.
"""

from __future__ import annotations

import math

RIGHT_WITHIN, RIGHT_TURN = 0.5, math.pi / 18.0
"""Error (m, rad) up to which a pose counts as right."""
REMEMBERED = 2.0
"""Distance (m) over which `hits` is averaged."""
CONSTANT, HITS, THROUGH = -0.25, 0.92, -39.0
"""Log-odds added per metre: constant, times the share of hits, and times the share of beams through walls."""
FIRST = 3.0
"""Metres that the first scan counts as: it is independent of all others."""
LEAST = 0.02
"""Smallest number of metres a scan counts as, such as one of a robot that stands: it repeats the one before."""
GOES_WRONG, COMES_RIGHT = 0.010, 0.013
"""Probability per metre that a right pose goes wrong, and that a wrong one becomes right by itself."""

MOST = 14.0
"""Largest magnitude of the log-odds."""
UNSEEN, CHOSEN = 0.5, 0.2
"""Initial probability of a pose given by a user, and of a rival found by a search."""


class Reliability:
    """Bayes filter of one hypothesis.

    Attributes:
        hits: Share of the beams that hit mapped obstacles, averaged over the last REMEMBERED metres.
        right: Probability that the pose is right, without regard to rivals and covariance.
    """

    def __init__(self, chosen: bool = False) -> None:
        """Begin with a user's pose, or one `chosen` as a scan fits there, which is then no further evidence."""
        self.hits, self._way = 0.0, 0.0
        self.right = CHOSEN if chosen else UNSEEN
        self._first = 0.0 if chosen else FIRST

    def update(self, hits: float, through: float, way: float) -> None:
        """Update by a scan: shares of hits and of beams through walls, 0 to 1, and distance (m) since the last one."""
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
    """Return the probability that a position with a standard deviation (m) per axis errs less than RIGHT_WITHIN."""
    return -math.expm1(-0.5 * (RIGHT_WITHIN / max(deviation, 1e-3)) ** 2)
