"""The tempered likelihood of a scan, and the poses where it and a prior together are highest."""

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
"""A scan says no more than so many independent beams would: its beams hit the same few walls, by the same error."""
OUTLIERS = 0.15
"""Share of beams that hit something the map does not have; it bounds what one beam can say against a pose."""
NARROWING = 1.0 / math.sqrt(3.0)
"""amcl's cubed sum sees laser_sigma_hit narrowed by this, so a user's sigma keeps its meaning."""
WIDE_SIGMA = 0.3
"""Deviation (m) at which the climb starts, so that walls are found from farther away."""
SPACING = 0.1
"""One endpoint (m) in each square of this side: a near wall must not outvote a far one."""
ITERATIONS = 5
EVERY = np.empty(0, dtype=bool)
"""In place of a mask that leaves nothing out."""
CLEARLY = 1.0
"""Logarithm of the probability by which one place is clearly better than another."""
WIDENING = 1.5
"""Factor on the deviations around a maximum, so that the proposal's tails lie above the target's."""


@dataclass(frozen=True)
class Modes:
    """Maxima of prior times likelihood.

    Attributes:
        poses: Shape (K, 3).
        covariances: Shape (K, 3, 3), inverse curvature at each.
        log_masses: Shape (K,): log of the probability around each, up to a constant (Laplace's approximation).
        explained: Shape (K,): share of the beams that hit what the map holds.
    """

    poses: np.ndarray
    covariances: np.ndarray
    log_masses: np.ndarray
    explained: np.ndarray

    def only(self, chosen: np.ndarray) -> Modes:
        """Return those a mask, shape (K,), says."""
        return Modes(self.poses[chosen], self.covariances[chosen], self.log_masses[chosen], self.explained[chosen])


class ScanLikelihood:
    """Likelihood of endpoints on a map's distance field: a mixture of hit and anything, tempered."""

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
            news: Share of the scan, 0 to 1, that earlier ones have not told.
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
        """Climb from each start, shape (K, 3), to the nearest maximum of prior times likelihood; one of each is kept.
        """
        poses, covariances, explained = self._climb(
            starts, prior, endpoints, self._narrowing, news * temper(len(endpoints)))
        heights = self.log(poses, endpoints, news) + prior.log_density(poses)
        kept = indices_apart(poses, heights, len(poses), distance=0.02, turn=0.01)
        covariances, masses = covariances[kept], heights[kept]
        if len(kept) > 1:  # of one alone nothing is to be compared
            masses += 0.5 * np.linalg.slogdet(covariances)[1]
        return Modes(poses[kept], covariances, masses, explained[kept])

    def sharpest(self, starts: np.ndarray, prior: PoseGaussian, endpoints: np.ndarray) -> np.ndarray:
        """Return the highest maximum of prior times likelihood, not tempered, next to starts, (K, 3); shape (3,).

        Beams that err alike make a belief too sure, but hardly draw the maximum aside: tempered, it is left where
        odometry's error still shows. The first start's is returned where no other is clearly higher.
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
    """Return the factor that makes so many dependent beams count as a few independent ones."""
    return min(1.0, INDEPENDENT_BEAMS / max(1, beams))


def thin_out(endpoints: np.ndarray, most: int = 1 << 30, among: np.ndarray = EVERY) -> np.ndarray:
    """Return endpoints with at most one in each square of SPACING and at most so many.

    Args:
        endpoints: Shape (B, 2).
        most: How many at most.
        among: Bool of shape (B,): those to choose from.
    """
    chosen = np.empty((len(endpoints), 2))
    count = first_in_squares(np.ascontiguousarray(endpoints), among, SPACING, chosen)
    step = max(1, -(-count // most))
    kept: np.ndarray = chosen[:count] if step == 1 else np.ascontiguousarray(chosen[:count:step])
    return kept


def some_of(endpoints: np.ndarray, count: int) -> np.ndarray:
    """Return about `count` of a scan's endpoints, shape (B, 2), every so-manieth of them."""
    return np.ascontiguousarray(endpoints[:: max(1, len(endpoints) // count)])


def apart(poses: np.ndarray, values: np.ndarray, count: int, distance: float, turn: float) -> List[int]:
    """Return indices of up to `count` poses, highest values first, no two within `distance` (m) and `turn` (rad)."""
    indices: List[int] = indices_apart(poses, values, count, distance, turn).tolist()
    return indices


def indices_apart(poses: np.ndarray, values: np.ndarray, count: int, distance: float, turn: float) -> np.ndarray:
    """Return what `apart` does, as an array."""
    order, chosen = np.argsort(-values)[: 50 * count], np.empty(count, dtype=np.int64)
    return chosen[:choose_apart(np.ascontiguousarray(poses), order, count, distance, turn, chosen)]


def mixture_around(modes: Modes) -> PoseMixture:
    """Return the proposal around maxima: shares by their mass, a few draws for each, deviations widened."""
    parts = tuple(PoseGaussian(p, c * WIDENING ** 2) for p, c in zip(modes.poses, modes.covariances))
    if len(parts) == 1:
        return PoseMixture(parts, np.ones(1))
    shares = np.exp(modes.log_masses - modes.log_masses.max())
    shares = 0.95 * shares / shares.sum() + 0.05 / len(shares)
    return PoseMixture(parts, shares / shares.sum())
