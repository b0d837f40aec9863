"""Normal distributions over poses, with the heading on its circle."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, normalize_angles
from mbf_relay.localization.gaussian_kernels import log_mixture, moments

FLOOR = np.array([0.02, 0.02, 0.01])
"""Least deviations (m, m, rad) of a cluster of particles: what lies in one place can neither spread nor be fitted."""

LEAST = 1e-3
"""Share of FLOOR's variance that is added in any case: particles on one line cannot be fitted either."""

LOG_NORMALIZER = -1.5 * math.log(2.0 * math.pi)


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

    def shortfall(self) -> np.ndarray:
        """Return the deviations, shape (3,), of independent noise that makes it no narrower than FLOOR."""
        floor = np.square(FLOOR)
        deviations: np.ndarray = np.sqrt(np.maximum(floor - np.diag(self.covariance), LEAST * floor))
        return deviations

    @property
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
        """Return the log-density at poses, (N, 3) in, (N,) out."""
        return PoseMixture((self,), np.ones(1)).log_density(poses)

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw poses, shape (count, 3)."""
        return PoseMixture((self,), np.ones(1)).sample(count, rng)


@dataclass(frozen=True)
class PoseMixture:
    """A mixture of normal distributions with shares that sum to one."""

    parts: Tuple[PoseGaussian, ...]
    shares: np.ndarray

    def log_density(self, poses: np.ndarray) -> np.ndarray:
        """Return the log-density at poses, (N, 3) in, (N,) out."""
        return self.log_densities(poses)[1]

    def log_densities(self, poses: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Return the log-densities of the first part alone and of the mixture at poses, (N, 3) in, each (N,) out."""
        roots = np.linalg.cholesky([part.covariance for part in self.parts])
        heights = np.log(self.shares) + LOG_NORMALIZER - np.log(np.diagonal(roots, axis1=1, axis2=2)).sum(axis=1)
        means = np.array([part.mean for part in self.parts])
        first, logs = np.empty(len(poses)), np.empty(len(poses))
        log_mixture(np.ascontiguousarray(poses), means, np.linalg.inv(roots), heights, first, logs)
        first -= math.log(self.shares[0])
        return first, logs

    def sample(self, count: int, rng: np.random.Generator) -> np.ndarray:
        """Draw poses, shape (count, 3), those of one part after those of another."""
        poses: np.ndarray = rng.standard_normal((count, 3))
        end = 0
        for part, drawn in zip(self.parts, rng.multinomial(count, self.shares)):
            own, end = poses[end:end + drawn], end + drawn
            own[:] = own @ np.linalg.cholesky(part.covariance).T + part.mean
        poses[:, 2] = normalize_angles(poses[:, 2])
        return poses


def log_sum_exp(values: np.ndarray) -> float:
    """Return log(sum(exp(values))) without overflow or underflow."""
    highest = float(values.max())
    return highest + math.log(float(np.exp(values - highest).sum()))
