"""Intervals: how far a share, a mean or a difference can be trusted."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Mapping, NamedTuple, Sequence

import numpy as np

RESAMPLINGS = 10_000


class Estimate(NamedTuple):
    """A value and the interval that holds it with 95 % confidence; NaN where nothing was measured."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{self.value:.3f} [{self.low:.3f}, {self.high:.3f}]"


NOTHING = Estimate(math.nan, math.nan, math.nan)


def share(successes: float, trials: float, confidence: float = 0.95) -> Estimate:
    """Return a share with its score interval (Wilson 1927), which stays honest near 0 and 1.

    Args:
        successes: How many of `trials` succeeded.
        trials: How many there were.
        confidence: Confidence of the interval.
    """
    if trials == 0:
        return NOTHING
    z = NormalDist().inv_cdf(0.5 + confidence / 2.0)
    p = successes / trials
    spread = z * math.sqrt(p * (1.0 - p) / trials + z * z / (4.0 * trials * trials))
    middle = p + z * z / (2.0 * trials)
    scale = 1.0 + z * z / trials
    return Estimate(p, max(0.0, (middle - spread) / scale), min(1.0, (middle + spread) / scale))


def grouped_share(groups: Mapping[str, Sequence[float]], confidence: float = 0.95) -> Estimate:
    """Return the share of ones among samples of 0 and 1, with a score interval that knows that groups are alike within.

    As many trials are counted as would have that much spread if they were independent (Kish's design effect), but no
    fewer than there are groups; where all samples agree, nothing tells their likeness, and each group counts once.

    Args:
        groups: The samples of each group, e.g. of each world.
        confidence: Confidence of the interval.
    """
    filled = [np.asarray(samples, dtype=float) for _, samples in sorted(groups.items()) if len(samples)]
    if not filled:
        return NOTHING
    trials = float(sum(len(samples) for samples in filled))
    p = sum(float(samples.sum()) for samples in filled) / trials
    counted = trials
    if 1 < len(filled) < trials:
        counted = float(len(filled))
        if 0.0 < p < 1.0:
            k = len(filled)
            residuals = np.array([(samples - p).sum() for samples in filled])
            variance = k / (k - 1.0) * float((residuals**2).sum()) / trials**2
            counted = min(trials, max(counted, p * (1.0 - p) / variance)) if variance > 0.0 else trials
    return share(p * counted, counted, confidence)


def mean(groups: Mapping[str, Sequence[float]], seed: int = 0, confidence: float = 0.95) -> Estimate:
    """Return the mean over all samples with its bootstrap interval, groups drawn as a whole.

    Episodes of one world resemble each other, so worlds are drawn, not episodes (a cluster bootstrap; Davison and
    Hinkley, Bootstrap Methods and their Application, 3.8). A difference is given by differences as samples, paired.

    Args:
        groups: The samples of each group, e.g. of each world.
        seed: Seed of the draws: equal samples give equal intervals.
        confidence: Confidence of the interval.
    """
    filled = [np.asarray(samples, dtype=float) for _, samples in sorted(groups.items()) if len(samples)]
    if not filled:
        return NOTHING
    sums = np.array([samples.sum() for samples in filled])
    sizes = np.array([len(samples) for samples in filled], dtype=float)
    value = float(sums.sum() / sizes.sum())
    if len(filled) == 1:
        if len(filled[0]) == 1:
            return Estimate(value, math.nan, math.nan)
        sums, sizes = filled[0], np.ones(len(filled[0]))
    drawn = np.random.default_rng(seed).integers(0, len(sums), (RESAMPLINGS, len(sums)))
    means = sums[drawn].sum(axis=1) / sizes[drawn].sum(axis=1)
    tail = 50.0 * (1.0 - confidence)
    low, high = (float(bound) for bound in np.percentile(means, [tail, 100.0 - tail]))
    return Estimate(value, low, high)


def sign_test(gained: int, lost: int) -> float:
    """Return the chance of a split at least this uneven if both sides were equally likely (exact, two-sided).

    Args:
        gained: Pairs in which the second succeeded and the first failed.
        lost: Pairs the other way round; pairs that agree say nothing and are left out (McNemar's exact test).
    """
    pairs = gained + lost
    if pairs == 0:
        return 1.0
    tail = sum(_binomial(pairs, k) for k in range(min(gained, lost) + 1)) / 2.0**pairs
    return min(1.0, 2.0 * tail)


def _binomial(n: int, k: int) -> int:
    result = 1
    for i in range(min(k, n - k)):
        result = result * (n - i) // (i + 1)
    return result
