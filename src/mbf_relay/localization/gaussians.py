"""Normal distributions over poses, with the heading on its circle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, normalize_angles
from mbf_relay.localization.gaussian_kernels import (
    factorize,
    fit_and_spread,
    log_mixture,
    log_normal,
    moments,
    normalize,
    redraw,
)

FLOOR = np.array([0.02, 0.02, 0.01])
"""Least deviations (m, m, rad) of a cluster of particles: what lies in one place can neither spread nor be fitted."""

LEAST = 1e-3
"""Share of FLOOR's variance that is added in any case: particles on one line cannot be fitted either."""

LOG_NORMALIZER = -1.5 * math.log(2.0 * math.pi)
NOT_POSITIVE = "a covariance is not positive definite"


@dataclass(frozen=True)
class PoseGaussian:
    """A normal distribution over poses: mean of shape (3,), covariance of shape (3, 3)."""

    mean: np.ndarray
    covariance: np.ndarray

    @staticmethod
    def fitted(poses: np.ndarray, weights: np.ndarray) -> PoseGaussian:
        """Return the distribution with the moments of weighted poses, shape (N, 3)."""
        mean, covariance = np.empty(3), np.empty((3, 3))
        moments(np.ascontiguousarray(poses), np.ascontiguousarray(weights), mean, covariance)
        return PoseGaussian(mean, covariance)

    @cached_property
    def information(self) -> np.ndarray:
        """Inverse of the covariance, shape (3, 3)."""
        return np.linalg.inv(self.covariance)

    def widened(self, deviations: np.ndarray) -> PoseGaussian:
        """Return a wider one: `deviations` (m, m, rad) are added as independent noise."""
        return PoseGaussian(self.mean, self.covariance + np.diag(np.square(deviations)))

    def moved(self, step: Pose2D, noise: np.ndarray) -> PoseGaussian:
        """Return it after a step in its own frame with noise of a covariance, shape (3, 3), in that frame."""
        cos, sin = math.cos(self.mean[2]), math.sin(self.mean[2])
        to_map = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        after = np.array(Pose2D(*map(float, self.mean)).compose(step))
        along = np.array([[1.0, 0.0, self.mean[1] - after[1]], [0.0, 1.0, after[0] - self.mean[0]], [0.0, 0.0, 1.0]])
        return PoseGaussian(after, along @ self.covariance @ along.T + to_map @ noise @ to_map.T)

    def log_density(self, poses: np.ndarray) -> np.ndarray:
        """Return the log-density at poses, (N, 3) in, (N,) out; LinAlgError where it has none."""
        logs = np.empty(len(poses))
        moments = np.ascontiguousarray(self.mean), np.ascontiguousarray(self.covariance)
        if not log_normal(np.ascontiguousarray(poses), *moments, LOG_NORMALIZER, logs):
            raise np.linalg.LinAlgError(NOT_POSITIVE)
        return logs

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw poses, shape (count, 3)."""
        return PoseMixture((self,), np.ones(1)).sample(count, rng)


class Factors(NamedTuple):
    """What densities and samples of K normal distributions are reckoned from.

    Attributes:
        means: Shape (K, 3).
        roots: Of the covariances, lower triangular, shape (K, 3, 3); a root times its transpose is the covariance.
        whitening: The roots' inverses, shape (K, 3, 3).
        log_heights: Log-density of each at its mean, its share in a mixture, shape (K,).
    """

    means: np.ndarray
    roots: np.ndarray
    whitening: np.ndarray
    log_heights: np.ndarray


@dataclass(frozen=True)
class PoseMixture:
    """A mixture of normal distributions with shares that sum to one."""

    parts: Tuple[PoseGaussian, ...]
    shares: np.ndarray

    def log_density(self, poses: np.ndarray) -> np.ndarray:
        """Return the log-density at poses, (N, 3) in, (N,) out."""
        return self.log_densities(poses)[1]

    @cached_property
    def factors(self) -> Factors:
        """Its parts as kernels take them; LinAlgError where a covariance is not positive definite."""
        means, covariances = self.moments
        roots, whitening, log_roots = np.empty_like(covariances), np.empty_like(covariances), np.empty(len(covariances))
        if not factorize(covariances, roots, whitening, log_roots):
            raise np.linalg.LinAlgError(NOT_POSITIVE)
        return Factors(means, roots, whitening, np.log(self.shares) + LOG_NORMALIZER - log_roots)

    @property
    def moments(self) -> Tuple[np.ndarray, np.ndarray]:
        """Means and covariances of the parts, shapes (K, 3) and (K, 3, 3)."""
        return np.array([part.mean for part in self.parts]), np.array([part.covariance for part in self.parts])

    def log_densities(self, poses: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Return the log-densities of the first part alone and of the mixture at poses, (N, 3) in, each (N,) out."""
        first, logs = np.empty(len(poses)), np.empty(len(poses))
        means, _, whitening, heights = self.factors
        log_mixture(np.ascontiguousarray(poses), means, whitening, heights, first, logs)
        first -= math.log(self.shares[0])
        return first, logs

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw poses, shape (count, 3), those of one part after those of another."""
        poses: np.ndarray = rng.standard_normal((count, 3))
        end = 0
        for mean, root, drawn in zip(*self.factors[:2], rng.multinomial(count, self.shares)):
            own, end = poses[end:end + drawn], end + drawn
            own[:] = own @ root.T + mean
        poses[:, 2] = normalize_angles(poses[:, 2])
        return poses


class PoseSample:
    """Weighted poses that stand for a normal distribution, and may be drawn anew in part.

    Attributes:
        poses: Shape (N, 3): those handed in, spread where they were narrower than FLOOR.
        log_weights: Shape (N,), with the sum that they were handed in with.
        prior: The distribution.
    """

    def __init__(self, poses: np.ndarray, log_weights: np.ndarray, rng: np.random.Generator) -> None:
        """Fit and spread poses, shape (N, 3), with the logarithms of their weights, shape (N,)."""
        mean, covariance = np.empty(3), np.empty((3, 3))
        self.poses, self._weights = rng.standard_normal(poses.shape), np.empty(len(poses))
        self.log_weights = log_weights.copy()
        self._log_total = fit_and_spread(
            np.ascontiguousarray(poses), self.log_weights, self.poses, FLOOR, LEAST, self._weights, mean, covariance
        )
        self.prior = PoseGaussian(mean, covariance)

    def redraw(self, share: float, around: PoseMixture, rng: np.random.Generator) -> None:
        """Draw about a share of the poses from another distribution instead, and weigh all as samples of the prior.

        Those that stay and those drawn are samples of two distributions of one target, and weighed together by the
        balance heuristic (Veach and Guibas 1995). What stays keeps its weight in that: forgotten, the belief would
        widen at every scan, of itself.
        """
        drawn = rng.random(len(self.poses)) < share
        count = int(np.count_nonzero(drawn))
        if not 0 < count < len(drawn):
            return
        share = count / len(drawn)
        noise, counts = rng.standard_normal((count, 3)), rng.multinomial(count, around.shares)
        means, covariances = PoseMixture((self.prior, *around.parts), around.shares).moments
        log_shares = np.log(np.concatenate(([1.0 - share], share * around.shares))) + LOG_NORMALIZER
        if not redraw(
            self.poses, self.log_weights, self._weights, self._log_total, drawn, noise, counts, means, covariances,
            log_shares,
        ):
            raise np.linalg.LinAlgError(NOT_POSITIVE)


def normalized(log_weights: np.ndarray) -> Tuple[np.ndarray, np.ndarray, float]:
    """Return the logarithms of weights, shape (N,), with sum one, these weights, and the logarithm of what the sum was.
    """
    logs, weights = log_weights.copy(), np.empty(len(log_weights))
    log_sum = normalize(logs, weights)
    return logs, weights, float(log_sum)


def log_sum_exp(values: np.ndarray) -> float:
    """Return log(sum(exp(values))) without overflow or underflow."""
    highest = float(values.max())
    return highest + math.log(float(np.exp(values - highest).sum()))
