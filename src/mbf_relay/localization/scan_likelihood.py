"""The tempered likelihood of a scan, and the maxima of the posterior of a prior and a scan."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.gaussians import PoseGaussian, PoseMixture
from mbf_relay.localization.laser_kernels import sum_over_endpoints
from mbf_relay.localization.refinement_kernels import choose_apart, climb, credit_from_behind
from mbf_relay.localization.resampling_kernels import first_in_squares

INDEPENDENT_BEAMS = 30.0
"""Number of independent beams that a scan's log-likelihood is scaled down to: its beams err alike."""
OUTLIERS = 0.15
"""Share of beams that hit something unmapped; it bounds the evidence of one beam against a pose."""
NARROWING = 1.0 / math.sqrt(3.0)
"""Factor on laser_sigma_hit, by which the cube in amcl's model narrows a Gaussian: users' values are tuned to that."""
WIDE_SIGMA = 0.3
"""Standard deviation (m) of a hit in the first iterations, so that walls attract poses from farther away."""
SPACING = 0.1
"""Side (m) of the squares of which each keeps one endpoint, so that a near wall does not outweigh a far one."""
ITERATIONS = 5
"""Gauss-Newton steps at each standard deviation."""
EVERY = np.empty(0, dtype=bool)
"""Mask that stands for all."""
CLEARLY = 1.0
"""Log of the probability ratio from which on one maximum is preferred to the first."""
WIDENING = 1.5
"""Factor on the deviations around a maximum, so that the proposal's tails lie above the target's."""


@dataclass(frozen=True)
class Modes:
    """Maxima of prior times likelihood.

    Attributes:
        poses: Shape (K, 3).
        covariances: Shape (K, 3, 3), inverse curvature at each.
        log_masses: Shape (K,): log of the probability around each, up to a constant (Laplace's approximation).
        explained: Shape (K,): share of the beams that the map explains, 0 to 1.
    """

    poses: np.ndarray
    covariances: np.ndarray
    log_masses: np.ndarray
    explained: np.ndarray

    def only(self, chosen: np.ndarray) -> Modes:
        """Return the modes chosen by a mask, bool of shape (K,)."""
        return Modes(self.poses[chosen], self.covariances[chosen], self.log_masses[chosen], self.explained[chosen])


class ScanLikelihood:
    """Likelihood of endpoints on the distance field: a mixture of hit and outlier for each beam, tempered."""

    def __init__(self, field: DistanceField, sigma_hit: float) -> None:
        self._field = field
        self._occupancy = np.require(field.occupancy.data, np.int8, ("C", "W"))
        self._sigma = sigma_hit * NARROWING
        self._narrowing, self._narrow = np.array([max(WIDE_SIGMA, self._sigma), self._sigma]), np.array([self._sigma])
        squared = np.square(field.face_distances) * np.float32(-0.5 / self._sigma ** 2)
        self._table = np.log(np.float32(1.0 - OUTLIERS) * np.exp(squared) + np.float32(OUTLIERS))
        self._outside = math.log(OUTLIERS)

    def log(self, poses: np.ndarray, endpoints: np.ndarray, news: float = 1.0) -> np.ndarray:
        """Return the tempered log-likelihood of a scan at poses.

        Args:
            poses: Shape (N, 3), in the map's frame.
            endpoints: Of the scan, shape (B, 2), in the base's frame.
            news: Weight of the scan, 0 to 1: how much of it is independent of earlier scans.
        """
        sums = np.empty(len(poses))
        field = self._field
        sum_over_endpoints(
            np.ascontiguousarray(poses), endpoints, field.codes, self._table, self._outside, field.frame, sums
        )
        sums *= news * temper(len(endpoints))
        return sums

    def modes(
        self, starts: np.ndarray, prior: PoseGaussian, endpoints: np.ndarray, news: float = 1.0
    ) -> Modes:
        """Return the distinct maxima of prior times likelihood next to the starts, shape (K, 3); rest as for `log`."""
        poses, covariances, explained = self._climb(
            starts, prior, endpoints, self._narrowing, news * temper(len(endpoints)))
        heights = self.log(poses, endpoints, news) + prior.log_density(poses)
        kept = indices_apart(poses, heights, len(poses), distance=0.02, turn=0.01)
        covariances, masses = covariances[kept], heights[kept]
        if len(kept) > 1:  # of one alone nothing is to be compared
            masses += 0.5 * np.linalg.slogdet(covariances)[1]
        return Modes(poses[kept], covariances, masses, explained[kept])

    def sharpest(self, starts: np.ndarray, prior: PoseGaussian, endpoints: np.ndarray) -> np.ndarray:
        """Return the highest maximum, shape (3,), of prior times untempered likelihood next to starts, (K, 3).

        Correlated beams make a belief overconfident but hardly shift its maximum, whereas the tempered maximum keeps
        part of odometry's error. The first start's maximum is returned where no other is clearly higher.
        """
        poses, _, _ = self._climb(starts, prior, endpoints, self._narrow, 1.0)
        if len(poses) == 1:
            return np.asarray(poses[0])
        from_behind, field = np.empty(len(poses)), self._field
        credit_from_behind(
            poses, endpoints, field.codes, self._occupancy, field.frame, self._table, self._outside, from_behind)
        heights = self.log(poses, endpoints) / temper(len(endpoints)) - from_behind + prior.log_density(poses)
        heights[0] += CLEARLY
        return np.asarray(poses[int(np.argmax(heights))])

    def _climb(
        self, starts: np.ndarray, prior: PoseGaussian, endpoints: np.ndarray, sigmas: np.ndarray, factor: float
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the maxima next to starts, shape (K, 3), their covariances and the shares of beams explained there.
        """
        poses = np.array(starts, dtype=float, order="C")
        covariances, explained = np.empty((len(poses), 3, 3)), np.empty(len(poses))
        climb(
            poses, endpoints, self._field.codes, self._field.face_distances, self._field.frame, sigmas, OUTLIERS,
            factor, prior.mean, prior.information, ITERATIONS, covariances, explained,
        )
        return poses, covariances, explained


def temper(beams: int) -> float:
    """Return the factor on log-likelihoods that scales so many dependent beams to INDEPENDENT_BEAMS."""
    return min(1.0, INDEPENDENT_BEAMS / max(1, beams))


def thin_out(endpoints: np.ndarray, most: int = 1 << 30, among: np.ndarray = EVERY) -> np.ndarray:
    """Return at most `most` of some endpoints, at most one in each square of SPACING.

    Args:
        endpoints: Shape (B, 2).
        most: Largest number.
        among: Bool of shape (B,): the endpoints to choose from; EVERY for all.
    """
    chosen = np.empty((len(endpoints), 2))
    count = first_in_squares(np.ascontiguousarray(endpoints), among, SPACING, chosen)
    step = max(1, -(-count // most))
    kept: np.ndarray = chosen[:count] if step == 1 else np.ascontiguousarray(chosen[:count:step])
    return kept


def some_of(endpoints: np.ndarray, count: int) -> np.ndarray:
    """Return every n-th of a scan's endpoints, shape (B, 2): between `count`, if there are so many, and twice that."""
    return np.ascontiguousarray(endpoints[:: max(1, len(endpoints) // count)])


def apart(poses: np.ndarray, values: np.ndarray, count: int, distance: float, turn: float) -> List[int]:
    """Return indices of up to `count` poses, highest values first, no two within `distance` (m) and `turn` (rad)."""
    indices: List[int] = indices_apart(poses, values, count, distance, turn).tolist()
    return indices


def indices_apart(poses: np.ndarray, values: np.ndarray, count: int, distance: float, turn: float) -> np.ndarray:
    """Return the result of `apart` as an array."""
    order, chosen = np.argsort(-values)[: 50 * count], np.empty(count, dtype=np.int64)
    return chosen[:choose_apart(np.ascontiguousarray(poses), order, count, distance, turn, chosen)]


def mixture_around(modes: Modes) -> PoseMixture:
    """Return a proposal around maxima: shares by mass, with a minimum for each, and covariances widened."""
    parts = tuple(PoseGaussian(p, c * WIDENING ** 2) for p, c in zip(modes.poses, modes.covariances))
    if len(parts) == 1:
        return PoseMixture(parts, np.ones(1))
    shares = np.exp(modes.log_masses - modes.log_masses.max())
    shares = 0.95 * shares / shares.sum() + 0.05 / len(shares)
    return PoseMixture(parts, shares / shares.sum())
