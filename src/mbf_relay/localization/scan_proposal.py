"""A proposal distribution that uses the scan, for sparse scans, slipping odometry and unmapped walls.

Plain Monte Carlo localization needs particles near the true pose before the scan is used. After a metre of poor
odometry there are few, and likelihoods of many dependent beams are so peaked that these few decide alone. Here the
beams' log-likelihoods are tempered, and within each cluster the best particles are refined to the maxima of prior times
likelihood. Half of the cluster is redrawn around these, and every particle is weighted by target over proposal
(Grisetti, Stachniss, Burgard 2007, section IV, with a cluster of particles in place of their single one).
"""

from __future__ import annotations

import functools
import math
from typing import Callable, NamedTuple, Optional

import numpy as np

from mbf_relay.localization.estimate import cluster, heaviest_first
from mbf_relay.localization.gaussians import PoseGaussian, PoseSample, log_sum_exp, normalized
from mbf_relay.localization.scan_likelihood import Modes, ScanLikelihood, indices_apart, mixture_around, some_of

Weigh = Callable[[np.ndarray], np.ndarray]
"""Takes poses, (N, 3), and returns log-likelihoods of a scan, (N,)."""
CLUSTERS = 40
"""Clusters of particles, heaviest first, that are redrawn; a tracked robot has one or two, a lost one many."""
STARTS = 8
"""Particles of a cluster from which the climb to its maxima starts."""
MANY_STARTS = 150
"""The same for a cluster that spreads over several places (see AT_LARGE), each of which needs a start of its own."""
LOOKED_AT = 60
"""Particles whose likelihood is computed for each start, about, to choose the best for starts."""
AT_LARGE = (1.0, 1.0, 0.7)
"""Standard deviations (x m, y m, heading rad) of a cluster above which it gets MANY_STARTS."""
DRAWN = 0.5
"""Share of a cluster that is redrawn around its maxima when the whole scan is new information; the rest stays where
odometry put it."""

PREVIEWED = 40
"""Beams, about, by which starts are chosen; the climb itself uses all."""
FULL_CREDIT = 0.6
"""Share of the beams that the map must explain for a scan to have its full weight; below it the weight falls with the
third power of the share."""


class Proposed(NamedTuple):
    """A new particle set.

    Attributes:
        poses: Shape (N, 3).
        log_weights: Shape (N,), of weights that sum to one.
        weights: Shape (N,).
        log_likelihood: Log of the weighted mean over particles of the whole scan's likelihood.
        prior: Distribution of the heaviest cluster before the scan.
        best: Highest mode of that cluster after the scan.
        explained: Share of the beams that the map explains at that mode, 0 to 1.
    """

    poses: np.ndarray
    log_weights: np.ndarray
    weights: np.ndarray
    log_likelihood: float
    prior: PoseGaussian
    best: PoseGaussian
    explained: float


class Redrawn(NamedTuple):
    """A cluster of which a part was redrawn.

    Attributes:
        poses: Shape (N, 3).
        log_weights: Shape (N,), without the scan.
        likelihoods: Log-likelihoods of the scan, times its weight `news`, shape (N,).
        prior: Distribution of the cluster before.
        modes: Maxima of the prior times the scan's likelihood.
    """

    poses: np.ndarray
    log_weights: np.ndarray
    likelihoods: np.ndarray
    prior: PoseGaussian
    modes: Modes


class ScanProposal:
    """Draws and weights particles by prior and scan."""

    def __init__(self, likelihood: ScanLikelihood) -> None:
        """Use a likelihood of scans on the map."""
        self._likelihood = likelihood

    def propose(
        self, poses: np.ndarray, log_weights: np.ndarray, endpoints: np.ndarray, news: float, rng: np.random.Generator,
        weigh: Optional[Weigh] = None,
    ) -> Proposed:
        """Return a new particle set for a scan.

        Args:
            poses: Particles as odometry moved them, shape (N, 3).
            log_weights: Shape (N,).
            endpoints: Of the scan, shape (B, 2), thinned out, in the base's frame.
            news: Share of the scan, 0 to 1, that earlier ones have not told.
            rng: Random generator.
            weigh: Returns the log-likelihoods of the whole scan at poses; the tempered field's where None.
        """
        labels, count = cluster(poses)
        if weigh is None:
            look = functools.partial(self._likelihood.log, endpoints=endpoints, news=news)
        else:
            look = functools.partial(_counted, weigh, news)
        if count == 1:  # the only cluster: likelihoods are computed after redrawing
            first = self._redraw(poses, log_weights, look, endpoints, news, rng)
            poses, log_weights, likelihoods = first[:3]
        else:
            poses, log_weights, likelihoods = poses.copy(), log_weights.copy(), look(poses)
            weights = np.exp(log_weights + likelihoods - (log_weights + likelihoods).max())
            for rank, (label, _) in enumerate(heaviest_first(labels, weights, count)[:CLUSTERS]):
                own = np.nonzero(labels == label)[0]
                redrawn = self._redraw(poses[own], log_weights[own], look, endpoints, news, rng)
                poses[own], log_weights[own], likelihoods[own] = redrawn[:3]
                first = redrawn if rank == 0 else first
        top = int(np.argmax(first.modes.log_masses))
        best = PoseGaussian(first.modes.poses[top], first.modes.covariances[top])
        explained = float(first.modes.explained[top])
        # Of a scan of which the map explains little, what fits does so by chance.
        likelihoods *= min(1.0, explained / FULL_CREDIT) ** 3
        normal, weights, of_news = normalized(log_weights + likelihoods)
        log_likelihood = of_news if news == 1.0 else log_sum_exp(log_weights + likelihoods / news)
        return Proposed(poses, normal, weights, log_likelihood, first.prior, best, explained)

    def _redraw(
        self, poses: np.ndarray, log_weights: np.ndarray, look: Weigh, endpoints: np.ndarray, news: float,
        rng: np.random.Generator,
    ) -> Redrawn:
        """Redraw a part of a cluster, (N, 3) and (N,), around the maxima of its posterior."""
        sample = PoseSample(poses, log_weights, rng)
        prior = sample.prior
        starts = self._starts(sample.poses, sample.log_weights, prior.covariance, endpoints, news)
        modes = self._likelihood.modes(np.concatenate((starts, prior.mean[None])), prior, endpoints, news)
        sample.redraw(DRAWN * news, mixture_around(modes), rng)
        return Redrawn(sample.poses, sample.log_weights, look(sample.poses), prior, modes)

    def _starts(
        self, poses: np.ndarray, log_weights: np.ndarray, covariance: np.ndarray, endpoints: np.ndarray, news: float
    ) -> np.ndarray:
        """Return start poses for the refinement, shape (K, 3): of best weight and likelihood, apart from each other.

        Args:
            poses: Of a cluster, shape (N, 3).
            log_weights: Shape (N,).
            covariance: Of the cluster, shape (3, 3).
            endpoints: Of the scan, shape (B, 2), in the base's frame.
            news: Share of the scan, 0 to 1, that earlier ones have not told.
        """
        at_large = any(math.sqrt(covariance[i, i]) > AT_LARGE[i] for i in range(3))
        count = MANY_STARTS if at_large else STARTS
        some = slice(None, None, max(1, len(poses) // (LOOKED_AT * count)))
        looked_at = np.ascontiguousarray(poses[some])
        values = self._likelihood.log(looked_at, some_of(endpoints, PREVIEWED), news)
        values += log_weights[some]
        starts: np.ndarray = looked_at[indices_apart(looked_at, values, count, distance=0.1, turn=0.06)]
        return starts


def _counted(weigh: Weigh, news: float, poses: np.ndarray) -> np.ndarray:
    logs: np.ndarray = weigh(poses) * news
    return logs
