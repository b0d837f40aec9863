"""The tempered likelihood of a scan, and the poses where it and a prior together are highest."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

from mbf_relay.geometry import normalize_angles
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.gaussians import PoseGaussian, PoseMixture
from mbf_relay.localization.laser_kernels import sum_over_endpoints
from mbf_relay.localization.refinement_kernels import choose_apart, climb
from mbf_relay.localization.resampling import hash_table
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
        self._sigma = sigma_hit * NARROWING
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
        return sums * (news * temper(len(endpoints)))

    def modes(
        self, starts: np.ndarray, prior: PoseGaussian, endpoints: np.ndarray, news: float = 1.0
    ) -> Modes:
        """Climb from each start, shape (K, 3), to the nearest maximum of prior times likelihood; one of each is kept.
        """
        sigmas = (max(WIDE_SIGMA, self._sigma), self._sigma)
        poses, covariances, explained = self._climb(starts, prior, endpoints, sigmas, news * temper(len(endpoints)))
        heights = self.log(poses, endpoints, news) + prior.log_density(poses)
        kept = apart(poses, heights, len(poses), distance=0.02, turn=0.01)
        masses = heights[kept] + 0.5 * np.linalg.slogdet(covariances[kept])[1]
        return Modes(poses[kept], covariances[kept], masses, explained[kept])

    def sharpest(self, start: np.ndarray, prior: PoseGaussian, endpoints: np.ndarray) -> np.ndarray:
        """Return the maximum of prior times likelihood, not tempered, next to a start; both poses of shape (3,).

        Beams that err alike make a belief too sure, but hardly draw the maximum aside: tempered, it is left where
        odometry's error still shows.
        """
        poses, _, _ = self._climb(start[None], prior, endpoints, (self._sigma,), 1.0)
        pose: np.ndarray = poses[0]
        return pose

    def _climb(
        self, starts: np.ndarray, prior: PoseGaussian, endpoints: np.ndarray, sigmas: Tuple[float, ...], factor: float
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the maxima next to starts, shape (K, 3), their covariances and the shares of beams explained there.
        """
        poses = np.array(starts, dtype=float, order="C")
        covariances, explained = np.empty((len(poses), 3, 3)), np.empty(len(poses))
        climb(
            poses, endpoints, self._field.codes, self._field.face_distances, self._field.frame, np.array(sigmas),
            OUTLIERS, factor, prior.mean, prior.information, ITERATIONS, covariances, explained,
        )
        poses[:, 2] = normalize_angles(poses[:, 2])
        return poses, covariances, explained


def temper(beams: int) -> float:
    """Return the factor that makes so many dependent beams count as a few independent ones."""
    return min(1.0, INDEPENDENT_BEAMS / max(1, beams))


def thin_out(endpoints: np.ndarray, most: int = 1 << 30) -> np.ndarray:
    """Return endpoints, shape (B, 2), with at most one in each square of SPACING and at most so many."""
    first = np.empty(len(endpoints), dtype=np.int64)
    count = first_in_squares(np.ascontiguousarray(endpoints), SPACING, hash_table(len(endpoints)), first)
    kept: np.ndarray = endpoints[first[:count:max(1, -(-count // most))]]
    return kept


def some_of(endpoints: np.ndarray, count: int) -> np.ndarray:
    """Return about `count` of a scan's endpoints, shape (B, 2), every so-manieth of them."""
    return np.ascontiguousarray(endpoints[:: max(1, len(endpoints) // count)])


def apart(poses: np.ndarray, values: np.ndarray, count: int, distance: float, turn: float) -> List[int]:
    """Return indices of up to `count` poses, highest values first, no two within `distance` (m) and `turn` (rad)."""
    order, chosen = np.argsort(-values)[: 50 * count], np.empty(count, dtype=np.int64)
    found = choose_apart(np.ascontiguousarray(poses[order]), count, distance, turn, chosen)
    indices: List[int] = order[chosen[:found]].tolist()
    return indices


def mixture_around(modes: Modes) -> PoseMixture:
    """Return the proposal around maxima: shares by their mass, a few draws for each, deviations widened."""
    shares = np.exp(modes.log_masses - modes.log_masses.max())
    shares = 0.95 * shares / shares.sum() + 0.05 / len(shares)
    parts = tuple(PoseGaussian(p, c * WIDENING ** 2) for p, c in zip(modes.poses, modes.covariances))
    return PoseMixture(parts, shares / shares.sum())
