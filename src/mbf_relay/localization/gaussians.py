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
"""Smallest standard deviations (m, m, rad) of a cluster; a narrower one is spread to them."""

LEAST = 1e-3
"""Share of FLOOR's variance that is always added: particles on one line have a singular covariance, too."""

LOG_NORMALIZER = -1.5 * math.log(2.0 * math.pi)
"""Log-density of a normal distribution over three dimensions at its mean, for a covariance of determinant 1."""
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
        """Return the distribution with independent noise of `deviations` (m, m, rad) added."""
        return PoseGaussian(self.mean, self.covariance + np.diag(np.square(deviations)))

    def moved(self, step: Pose2D, noise: np.ndarray) -> PoseGaussian:
        """Return the distribution after a step with noise covariance, shape (3, 3), both in the mean's frame."""
        cos, sin = math.cos(self.mean[2]), math.sin(self.mean[2])
        to_map = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        after = np.array(Pose2D(*map(float, self.mean)).compose(step))
        along = np.array([[1.0, 0.0, self.mean[1] - after[1]], [0.0, 1.0, after[0] - self.mean[0]], [0.0, 0.0, 1.0]])
        return PoseGaussian(after, along @ self.covariance @ along.T + to_map @ noise @ to_map.T)

    def log_density(self, poses: np.ndarray) -> np.ndarray:
        """Return the log-density at poses, (N, 3) in, (N,) out; LinAlgError where it is not positive definite."""
        logs = np.empty(len(poses))
        moments = np.ascontiguousarray(self.mean), np.ascontiguousarray(self.covariance)
        if not log_normal(np.ascontiguousarray(poses), *moments, LOG_NORMALIZER, logs):
            raise np.linalg.LinAlgError(NOT_POSITIVE)
        return logs

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw poses, shape (count, 3)."""
        return PoseMixture((self,), np.ones(1)).sample(count, rng)


class Factors(NamedTuple):
    """Factors of K normal distributions, from which densities and samples are computed.

    Attributes:
        means: Shape (K, 3).
        roots: Cholesky factors of the covariances, lower triangular, shape (K, 3, 3).
        whitening: Inverses of the Cholesky factors, shape (K, 3, 3).
        log_heights: Log of share times density of each part at its mean, shape (K,).
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
        """Factors of the parts, as the kernels take them; LinAlgError where a covariance is not positive definite."""
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
        """Return log-densities at poses, (N, 3): of the first part by itself and of the mixture, (N,) each."""
        first, logs = np.empty(len(poses)), np.empty(len(poses))
        means, _, whitening, heights = self.factors
        log_mixture(np.ascontiguousarray(poses), means, whitening, heights, first, logs)
        first -= math.log(self.shares[0])
        return first, logs

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw poses, shape (count, 3), ordered by part."""
        poses: np.ndarray = rng.standard_normal((count, 3))
        end = 0
        for mean, root, drawn in zip(*self.factors[:2], rng.multinomial(count, self.shares)):
            own, end = poses[end:end + drawn], end + drawn
            own[:] = own @ root.T + mean
        poses[:, 2] = normalize_angles(poses[:, 2])
        return poses


class PoseSample:
    """Weighted samples of a normal distribution, a part of which can be redrawn from a better proposal.

    Attributes:
        poses: Shape (N, 3): the given ones, with noise where they were narrower than FLOOR.
        log_weights: Shape (N,); the sum of the weights is about that of the given ones.
        prior: The distribution fitted to them.
    """

    def __init__(self, poses: np.ndarray, log_weights: np.ndarray, rng: np.random.Generator) -> None:
        """Fit the distribution to poses, shape (N, 3), with log-weights, shape (N,), and spread them to FLOOR."""
        mean, covariance = np.empty(3), np.empty((3, 3))
        self.poses, self._weights = rng.standard_normal(poses.shape), np.empty(len(poses))
        self.log_weights = log_weights.copy()
        self._log_total = fit_and_spread(
            np.ascontiguousarray(poses), self.log_weights, self.poses, FLOOR, LEAST, self._weights, mean, covariance
        )
        self.prior = PoseGaussian(mean, covariance)

    def redraw(self, share: float, around: PoseMixture, rng: np.random.Generator) -> None:
        """Redraw about a share of the poses, 0 to 1, from the mixture `around`, and weight all as samples of the prior.

        Kept and redrawn poses are weighted together by the balance heuristic (multiple importance sampling, Veach and
        Guibas 1995). Kept poses also keep their relative weights; otherwise the belief would widen with every scan.

        Raises:
            LinAlgError: A covariance is not positive definite; poses and weights are as before.
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
    """Normalize log-weights, shape (N,): return log-weights and weights with sum one, and the log of the former sum."""
    logs, weights = log_weights.copy(), np.empty(len(log_weights))
    log_sum = normalize(logs, weights)
    return logs, weights, float(log_sum)


def log_sum_exp(values: np.ndarray) -> float:
    """Return log(sum(exp(values))) without overflow or underflow."""
    highest = float(values.max())
    return highest + math.log(float(np.exp(values - highest).sum()))
