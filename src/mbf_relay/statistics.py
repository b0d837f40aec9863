"""Confidence intervals and tests for shares, means and paired differences of grouped samples."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import List, Mapping, NamedTuple, Sequence

import numpy as np
from scipy import special

RESAMPLINGS = 10_000
"""Random sign vectors of the permutation test."""
MOST_TRIED = 12
"""Largest number of groups for which all sign vectors are tried; of more, RESAMPLINGS are drawn."""


class IntervalEstimate(NamedTuple):
    """A value and its confidence interval, of 95 % by default; NaN where nothing was measured.

    One sample alone has a value and no interval: its bounds are NaN.
    """

    value: float
    low: float
    high: float

    @property
    def has_interval(self) -> bool:
        """Return whether there is more than a single sample."""
        return not math.isnan(self.low)

    def interval(self) -> str:
        """Return the interval as text."""
        return f"[{self.low:.3f}, {self.high:.3f}]" if self.has_interval else "(one sample, no interval)"

    def __str__(self) -> str:
        return f"{self.value:.3f} {self.interval()}"


NOTHING = IntervalEstimate(math.nan, math.nan, math.nan)


def share(successes: float, trials: float, confidence: float = 0.95) -> IntervalEstimate:
    """Return a share with its score interval (Wilson 1927), which has its coverage near 0 and 1, too.

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
    return IntervalEstimate(p, max(0.0, (middle - spread) / scale), min(1.0, (middle + spread) / scale))


def grouped_share(groups: Mapping[str, Sequence[float]], confidence: float = 0.95) -> IntervalEstimate:
    """Return the share of ones among samples of 0 and 1, with a score interval that knows that groups are alike within.

    As many trials are counted as would have that much spread if they were independent (Kish's design effect), fewer
    where few groups tell of it (Korn and Graubard 1998), but no fewer than there are groups; where all samples agree,
    nothing tells their likeness, and each group counts once.

    Args:
        groups: The samples of each group, e.g. of each world.
        confidence: Confidence of the interval.
    """
    filled = [np.asarray(samples, dtype=float) for _, samples in sorted(groups.items()) if len(samples)]
    if not filled:
        return NOTHING
    sums, sizes = np.array([samples.sum() for samples in filled]), np.array([len(samples) for samples in filled])
    trials, k = float(sizes.sum()), len(filled)
    p = float(sums.sum()) / trials
    counted = trials
    if 1 < k < trials:
        counted = float(k)
        if 0.0 < p < 1.0:
            few = NormalDist().inv_cdf(0.5 + 0.5 * confidence) / _students_t(k - 1, confidence)
            variance = _variance_of_mean(sums, sizes, p)
            counted = min(trials, max(counted, few**2 * p * (1.0 - p) / variance)) if variance > 0.0 else trials
    return share(p * counted, counted, confidence)


def mean(groups: Mapping[str, Sequence[float]], confidence: float = 0.95) -> IntervalEstimate:
    """Return the mean over all samples with an interval by Student's t, of groups that count as a whole.

    Episodes of one world resemble each other, so worlds vary, not episodes (a ratio of sums over clusters; Cochran,
    Sampling Techniques, 9A). A difference is given by differences as samples, paired. Of a single group the samples
    vary: the interval tells of that group alone.

    Args:
        groups: The samples of each group, e.g. of each world.
        confidence: Confidence of the interval.
    """
    filled = [np.asarray(samples, dtype=float) for _, samples in sorted(groups.items()) if len(samples)]
    if not filled:
        return NOTHING
    sums, sizes = np.array([samples.sum() for samples in filled]), np.array([len(samples) for samples in filled])
    value = float(sums.sum() / sizes.sum())
    if len(filled) == 1:
        sums, sizes = filled[0], np.ones(len(filled[0]), dtype=int)
    if len(sums) == 1:
        return IntervalEstimate(value, math.nan, math.nan)
    reach = _students_t(len(sums) - 1, confidence) * math.sqrt(_variance_of_mean(sums, sizes, value))
    return IntervalEstimate(value, value - reach, value + reach)


def _variance_of_mean(sums: np.ndarray, sizes: np.ndarray, value: float) -> float:
    """Return the variance of a mean `value` of groups of so many samples (`sizes`) with these sums, shape (K,) each."""
    k = len(sums)
    return k / (k - 1.0) * float(((sums - value * sizes) ** 2).sum()) / float(sizes.sum()) ** 2


def _students_t(freedom: int, confidence: float) -> float:
    """Return how many standard errors an estimated spread of so many degrees of freedom reaches to each side."""
    return float(special.stdtrit(freedom, 0.5 + 0.5 * confidence))


def sign_test(groups: Mapping[str, Sequence[int]]) -> float:
    """Return the p-value of a sum of signs, if each group's sign were random (exact, two-sided).

    Pairs of one world are correlated, so the sign of the world's sum is random, not each pair's. With one pair per
    world it is McNemar's exact test.

    Args:
        groups: For each group, e.g. world, +1 for each pair in which the second alone succeeded, -1 where the first
            alone did, 0 where they agree.
    """
    sums = [abs(sum(samples)) for samples in groups.values() if sum(samples)]
    observed = abs(sum(sum(samples) for samples in groups.values()))
    reach = sum(sums)
    chances = np.zeros(2 * reach + 1)  # of each sum of signed group sums, from -reach on
    chances[reach] = 1.0
    for size in sums:
        chances = 0.5 * (np.roll(chances, size) + np.roll(chances, -size))
    far = np.abs(np.arange(-reach, reach + 1)) >= observed
    return min(1.0, float(chances[far].sum()))


def permutation_test(groups: Mapping[str, Sequence[float]], seed: int = 0) -> float:
    """Return the p-value of a mean difference, if each group's sign were random (two-sided).

    All signs are tried where there are few groups, 10 000 draws of them else.

    Args:
        groups: Differences of pairs, of each group, e.g. of each world.
        seed: Seed of the draws.
    """
    sums = np.array([float(np.sum(samples)) for _, samples in sorted(groups.items()) if len(samples)])
    sums = sums[sums != 0.0]
    if not len(sums):
        return 1.0
    observed = abs(sums.sum()) * (1.0 - 1e-12)
    if len(sums) <= MOST_TRIED:
        signs = 1.0 - 2.0 * ((np.arange(2 ** len(sums))[:, None] >> np.arange(len(sums))) & 1)
        return float((np.abs(signs @ sums) >= observed).mean())
    signs = 1.0 - 2.0 * np.random.default_rng(seed).integers(0, 2, (RESAMPLINGS, len(sums)))
    return (1.0 + float((np.abs(signs @ sums) >= observed).sum())) / (RESAMPLINGS + 1.0)


def least_groups(chance: float) -> int:
    """Return the smallest number of groups for which sign tests can give a p-value below `chance`.

    Args:
        chance: Significance level, e.g. 0.05; the smallest p-value of n groups is 2 / 2^n.
    """
    return math.floor(1.0 - math.log2(chance)) + 1


def holm(chances: Sequence[float]) -> List[float]:
    """Return p-values adjusted for multiple testing (Holm 1979)."""
    raised, least = [0.0] * len(chances), 0.0
    for rank, index in enumerate(sorted(range(len(chances)), key=lambda i: chances[i])):
        least = max(least, min(1.0, (len(chances) - rank) * chances[index]))
        raised[index] = least
    return raised
