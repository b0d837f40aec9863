"""A proposal that looks at the scan, for sparse scans, slipping odometry and walls the map does not have.

Plain Monte Carlo localization needs a particle near the truth before it looks at the scan. After a metre of poor
odometry few are, and the likelihoods of many dependent beams are so sure of themselves that those few decide alone.
Here the beams' log-likelihoods are tempered, and within each cluster the best particles climb to the maxima of prior
times likelihood; half of the cluster is then drawn around these, every particle weighed by target over proposal, so
that the belief stays one from odometry and scans (Grisetti, Stachniss, Burgard 2007, section IV, with a cluster of
particles in the place of their single one).

Where the map explains clearly less of a scan than it used to, scouts look farther than the belief reaches, the farther
the longer the drive in doubt. What they find enters with a small part of the belief and has to prove itself on the
scans that follow: a room that is not on the map looks like doubt, too, and something always looks like something else.
"""

from __future__ import annotations

import math
from typing import Optional, Tuple

import numpy as np

from mbf_relay.localization.estimate import cluster, heaviest_first
from mbf_relay.localization.gaussians import PoseGaussian, PoseMixture, log_sum_exp
from mbf_relay.localization.scan_likelihood import Modes, ScanLikelihood, apart, thin_out

CLUSTERS = 8
STARTS = 8
DRAWN = 0.5
"""Share of a cluster that is drawn around its maxima; the rest stays where odometry put it."""
WIDENING = 1.5
"""Factor on the deviations around a maximum, so that the proposal's tails lie above the target's."""
FEWEST_BEAMS = 5

FULL_CREDIT = 0.6
"""Share of the beams the map must explain for a scan to be believed in full; below, with the third power."""

SCOUTS = 6000
SCOUT_BEAMS = 60
BASE = np.array([0.25, 0.25, 0.15])
PER_METRE = np.array([0.3, 0.3, 0.1])
"""Deviations (m, m, rad) the scouts add to the belief, and what each metre driven in doubt adds to these."""
GAIN = 0.15
"""Share of the beams the map must explain better where a scout is than where the belief is."""
SLIP = 0.02
"""Probability that odometry failed altogether, where a scan calls for scouts."""
MOST = 0.1
"""Share of the belief that scouts are given at one scan at most."""


class Trust:
    """Whether scans fit as they used to: the share of beams the map explains against its own average.

    Attributes:
        driven: Distance (m) since the last scan that fitted.
    """

    DECAY = 0.05
    LOW = 0.75
    LEAST = 0.3

    def __init__(self) -> None:
        self._usual: Optional[float] = None
        self.driven = 0.0

    def is_lost(self, explained: float, driven: float) -> bool:
        """Take the share of one scan and the distance (m) to it; tell whether it is clearly below the usual."""
        usual = explained if self._usual is None else self._usual
        doubtful = explained < max(self.LEAST, self.LOW * usual)
        self.driven = self.driven + driven if doubtful else 0.0
        self._usual = usual + self.DECAY * (explained - usual)
        return doubtful


class ScanProposal:
    """Draws and weighs particles by prior and scan together.

    Attributes:
        explained: Share of the beams the map explained at the best pose of the last scan.
    """

    def __init__(self, likelihood: ScanLikelihood) -> None:
        self._likelihood = likelihood
        self._trust = Trust()
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
        # Of a scan in which little is on the map, what fits does so by chance.
        credit = min(1.0, self.explained / FULL_CREDIT) ** 3
        log_weights += credit * likelihoods
        if self._trust.is_lost(self.explained, driven):
            return self._send_scouts(poses, log_weights, belief, endpoints, credit, rng)
        return poses, log_weights

    def _redraw(
        self, members: np.ndarray, poses: np.ndarray, log_weights: np.ndarray, likelihoods: np.ndarray,
        endpoints: np.ndarray, rng: np.random.Generator,
    ) -> Modes:
        """Draw a part of a cluster anew around the maxima of its posterior; changes the three arrays in place."""
        own, own_weights = poses[members], log_weights[members]
        prior = PoseGaussian.fitted(own, np.exp(own_weights - own_weights.max()))
        values = likelihoods[members] + own_weights
        starts = own[apart(own, values, STARTS, distance=0.1, turn=0.06)]
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

    def _send_scouts(
        self, poses: np.ndarray, log_weights: np.ndarray, belief: PoseGaussian, endpoints: np.ndarray, credit: float,
        rng: np.random.Generator,
    ) -> Tuple[np.ndarray, np.ndarray]:
        """Add particles where odometry would not have led, if the map explains clearly more of the scan there."""
        wide = belief.widened(BASE + PER_METRE * self._trust.driven)
        scouts = wide.sample(SCOUTS, rng)
        few = thin_out(endpoints, SCOUT_BEAMS)
        starts = scouts[apart(scouts, self._likelihood.log(scouts, few), STARTS, 0.2, 0.1)]
        modes = self._likelihood.modes(starts, wide, endpoints)
        better = modes.explained > self.explained + GAIN
        if not better.any():
            return poses, log_weights
        modes = Modes(*(values[better] for values in (modes.poses, modes.covariances, modes.log_masses, modes.explained)))
        around = mixture_around(modes)
        found = around.sample(max(100, len(poses) // 4), rng)
        found_weights = math.log(SLIP) + wide.log_density(found) - around.log_density(found) - math.log(len(found))
        found_weights += credit * self._likelihood.log(found, endpoints)
        excess = log_sum_exp(found_weights) - log_sum_exp(log_weights) - math.log(MOST / (1.0 - MOST))
        return np.vstack((poses, found)), np.concatenate((log_weights, found_weights - max(0.0, excess)))


def mixture_around(modes: Modes) -> PoseMixture:
    """Return the proposal around maxima: shares by their mass, a few draws for each, deviations widened."""
    shares = np.exp(modes.log_masses - modes.log_masses.max())
    shares = 0.95 * shares / shares.sum() + 0.05 / len(shares)
    parts = tuple(PoseGaussian(p, c * WIDENING ** 2) for p, c in zip(modes.poses, modes.covariances))
    return PoseMixture(parts, shares / shares.sum())
