"""A proposal that looks at the scan, for sparse scans, slipping odometry and walls the map does not have.

Plain Monte Carlo localization needs a particle near the truth before it looks at the scan. After a metre of poor
odometry few are, and the likelihoods of many dependent beams are so sure of themselves that those few decide alone.
Here the beams' log-likelihoods are tempered, and within each cluster the best particles climb to the maxima of prior
times likelihood; half of the cluster is then drawn around these, every particle weighed by target over proposal, so
that the belief stays one from odometry and scans (Grisetti, Stachniss, Burgard 2007, section IV, with a cluster of
particles in the place of their single one).

Where the map explains clearly less of a scan than it used to, scouts look farther (scouts.py).
"""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np

from mbf_relay.localization.estimate import cluster, heaviest_first
from mbf_relay.localization.gaussians import PoseGaussian, log_sum_exp
from mbf_relay.localization.scan_likelihood import Modes, ScanLikelihood, apart, mixture_around, thin_out
from mbf_relay.localization.scouts import ASTRAY, GAIN, GAIN_ANYWHERE, RandomPoses, Scouts, Trust

CLUSTERS = 40
"""Clusters, heaviest first, that are looked into; a tracked robot has one or two, a lost one many."""
STARTS = 8
MANY_STARTS = 150
AT_LARGE = np.array([1.0, 1.0, 0.7])
"""Deviations (m, m, rad) from which a cluster is more than one place, and is climbed from many."""
DRAWN = 0.5
"""Share of a cluster that is drawn around its maxima; the rest stays where odometry put it."""
FEWEST_BEAMS = 5

FULL_CREDIT = 0.6
"""Share of the beams the map must explain for a scan to be believed in full; below, with the third power."""


class ScanProposal:
    """Draws and weighs particles by prior and scan together.

    Attributes:
        explained: Share of the beams the map explained at the best pose of the last scan.
    """

    def __init__(self, likelihood: ScanLikelihood, random_poses: RandomPoses, recovers: bool = False) -> None:
        """Draw by a likelihood.

        Args:
            likelihood: Of scans on the map.
            random_poses: Makes poses all over the map.
            recovers: Look all over the map whenever scans stop fitting; else only after a long drive in doubt.
        """
        self._likelihood = likelihood
        self._scouts = Scouts(likelihood, random_poses)
        self._recovers = recovers
        self._trust = Trust(wary=recovers)
        self.explained = 1.0

    def propose(
        self, poses: np.ndarray, log_weights: np.ndarray, hits: np.ndarray, driven: float, rng: np.random.Generator
    ) -> Tuple[np.ndarray, np.ndarray]:
        """Return a new particle set and its log-weights, not normalised.

        Args:
            poses: Particles as odometry moved them, shape (N, 3).
            log_weights: Shape (N,).
            hits: Endpoints of the scan, shape (B, 2), in the base's frame.
            driven: Distance (m) from the last scan to this one.
            rng: Where chance comes from.
        """
        endpoints = thin_out(hits)
        if len(endpoints) < FEWEST_BEAMS:
            return poses, log_weights
        labels, count = cluster(poses)
        prior_weights = np.exp(log_weights - log_weights.max())
        poses, log_weights = poses.copy(), log_weights.copy()
        likelihoods = self._likelihood.log(poses, endpoints)
        belief = PoseGaussian.fitted(poses, prior_weights)
        weights = np.exp(log_weights + likelihoods - (log_weights + likelihoods).max())
        for rank, (label, _) in enumerate(heaviest_first(labels, weights, count)[:CLUSTERS]):
            members = np.nonzero(labels == label)[0]
            modes = self._redraw(members, poses, log_weights, likelihoods, endpoints, rng)
            if rank == 0:
                self.explained = float(modes.explained[np.argmax(modes.log_masses)])
        found = None
        if self._trust.is_lost(self.explained, driven) or self._trust.astray > ASTRAY:
            found = self._scouts.search(
                belief, endpoints, self.explained, self._trust.driven, self._recovers or self._trust.astray > ASTRAY,
                GAIN_ANYWHERE if self._recovers else GAIN, max(100, len(poses) // 4), rng,
            )
        # Of a scan in which little is on the map, what fits does so by chance.
        explained = found.explained if found is not None and self._recovers else self.explained
        credit = min(1.0, explained / FULL_CREDIT) ** 3
        log_weights += credit * likelihoods
        return (poses, log_weights) if found is None else found.join(poses, log_weights, credit)

    def _redraw(
        self, members: np.ndarray, poses: np.ndarray, log_weights: np.ndarray, likelihoods: np.ndarray,
        endpoints: np.ndarray, rng: np.random.Generator,
    ) -> Modes:
        """Draw a part of a cluster anew around the maxima of its posterior; changes the three arrays in place."""
        own, own_weights = poses[members], log_weights[members]
        prior = PoseGaussian.fitted(own, np.exp(own_weights - own_weights.max()))
        values = likelihoods[members] + own_weights
        spread = np.sqrt(np.diag(prior.covariance))
        count = MANY_STARTS if (spread > AT_LARGE).any() else STARTS
        starts = own[apart(own, values, count, distance=0.1, turn=0.06)]
        modes = self._likelihood.modes(np.vstack((starts, prior.mean)), prior, endpoints)
        around = mixture_around(modes)
        drawn = rng.random(len(members)) < DRAWN
        own[drawn] = around.sample(int(drawn.sum()), rng)
        if drawn.any():
            likelihoods[members[drawn]] = self._likelihood.log(own[drawn], endpoints)
        target = prior.log_density(own)
        proposal = np.logaddexp(math.log(1.0 - DRAWN) + target, math.log(DRAWN) + around.log_density(own))
        poses[members] = own
        log_weights[members] = log_sum_exp(own_weights) - math.log(len(members)) + target - proposal
        return modes
