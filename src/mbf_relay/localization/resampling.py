"""KLD-adaptive resampling, with random particles of Augmented MCL (sections 4.3.4 and 8.3)."""

from __future__ import annotations

import functools
import math
from typing import Callable, Optional, Tuple

import numpy as np

from mbf_relay.localization.resampling_kernels import draw_until_enough

FreshPoses = Callable[[int], np.ndarray]
"""Takes a count and returns as many random poses, shape (count, 3)."""


@functools.lru_cache(maxsize=8)
def particle_limits(
    max_particles: int, min_particles: int, kld_err: float, kld_z: float, narrow_is_few: bool = False
) -> np.ndarray:
    """Return the number of particles required for k filled bins, k = 0 … max_particles (Fox 2003, equation 14).

    Args:
        max_particles, min_particles: Bounds.
        kld_err: Bound on the Kullback-Leibler distance.
        kld_z: Quantile for the probability that the bound holds.
        narrow_is_few: Whether one filled bin requires min_particles; amcl takes max_particles there, where the formula
            is not defined.
    """
    bins = np.arange(max_particles + 1, dtype=float)
    b = 2.0 / (9.0 * np.maximum(bins - 1.0, 1.0))
    needed = np.ceil((bins - 1.0) / (2.0 * kld_err) * (1.0 - b + np.sqrt(b) * kld_z) ** 3)
    limits: np.ndarray = np.clip(needed, min_particles, max_particles).astype(np.int64)
    limits[:2] = min_particles if narrow_is_few else max_particles
    return limits


def resample(
    poses: np.ndarray,
    weights: np.ndarray,
    limits: np.ndarray,
    rng: np.random.Generator,
    random_share: float = 0.0,
    random_poses: Optional[FreshPoses] = None,
) -> np.ndarray:
    """Draw a new set of particles by weight, some of them at random (Augmented MCL, table 8.3).

    Args:
        poses: Particles, shape (N, 3).
        weights: Shape (N,), not negative, sum above 0.
        limits: From `particle_limits`.
        rng: Random generator.
        random_share: Probability of a random pose in place of a drawn one.
        random_poses: Makes the random poses; needed where the share is above 0.

    Returns:
        Particles of equal weight, shape (M, 3) with M at most len(limits) - 1.
    """
    most = len(limits) - 1
    fresh_index, fresh = np.empty(0, dtype=np.int64), np.empty((0, 3))
    if random_share > 0.0 and random_poses is not None:
        chosen = np.nonzero(rng.random(most) < random_share)[0]
        fresh_index = np.full(most, -1, dtype=np.int64)
        fresh_index[chosen] = np.arange(len(chosen))
        fresh = np.ascontiguousarray(random_poses(len(chosen))) if len(chosen) else fresh
    drawn = np.empty((most, 3))
    count = draw_until_enough(
        np.ascontiguousarray(poses), np.ascontiguousarray(weights), rng.random(), fresh_index, fresh, limits, drawn,
    )
    return drawn[:count].copy()


def replicate(poses: np.ndarray, log_weights: np.ndarray, fewest: int) -> Tuple[np.ndarray, np.ndarray]:
    """Return particles and log-weights, each repeated equally often, so that there are `fewest` or more."""
    times = -(-fewest // len(poses))
    return np.repeat(poses, times, axis=0), np.repeat(log_weights, times) - math.log(times)


class AverageLikelihood:
    """The slow and the fast average of the scans' likelihood, w_slow and w_fast of Augmented MCL (table 8.3).

    Kept as logarithms, since likelihoods of many beams underflow.
    """

    def __init__(self) -> None:
        self._log_slow = -math.inf
        self._log_fast = -math.inf

    def update(self, log_average: float, alpha_slow: float, alpha_fast: float) -> None:
        """Take the log of the average likelihood of one update."""
        self._log_slow = self._decay(self._log_slow, log_average, alpha_slow)
        self._log_fast = self._decay(self._log_fast, log_average, alpha_fast)

    @staticmethod
    def _decay(log_old: float, log_new: float, alpha: float) -> float:
        if log_old == -math.inf:
            return log_new
        if alpha <= 0.0:
            return log_old
        return float(
            np.logaddexp(log_old + math.log1p(-alpha) if alpha < 1.0 else -math.inf, log_new + math.log(alpha))
        )

    def random_share(self) -> float:
        """Return the share of particles to draw at random: max(0, 1 - fast / slow)."""
        if self._log_slow == -math.inf:
            return 0.0
        return max(0.0, 1.0 - math.exp(min(0.0, self._log_fast - self._log_slow)))

    def reset(self) -> None:
        """Reset both averages, as amcl does after it has added random particles."""
        self._log_slow = self._log_fast = -math.inf
