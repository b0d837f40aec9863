"""Scouts: a look farther than the belief reaches, when scans no longer fit.

Odometry may have slipped, or the robot may have been carried. How far scouts go grows with the drive in doubt; with
amcl's recovery on they go anywhere on the map. What they find enters with a small part of the belief, and has to prove
itself on the scans that follow: a room that is not on the map looks like doubt, too, and something always looks like
something else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Callable, Optional, Tuple

import numpy as np

from mbf_relay.localization.gaussians import PoseGaussian, log_sum_exp
from mbf_relay.localization.scan_likelihood import ScanLikelihood, apart, mixture_around, thin_out

RandomPoses = Callable[[int], np.ndarray]
"""Makes so many poses all over the map, shape (count, 3)."""

SCOUTS, SCOUTS_ANYWHERE = 6000, 20000
SCOUT_BEAMS = 60
STARTS, STARTS_ANYWHERE = 8, 150
BASE = np.array([0.25, 0.25, 0.15])
PER_METRE = np.array([0.3, 0.3, 0.1])
"""Deviations (m, m, rad) the scouts add to the belief, and what each metre driven in doubt adds to these."""
ANYWHERE = np.array([100.0, 100.0, 10.0])
"""Deviations (m, m, rad) that leave no pose out."""
GAIN, GAIN_ANYWHERE = 0.15, 0.03
"""Share of the beams the map must explain better where a scout is than where the belief is. Anywhere, many places look
alike, and which of them it is only the next scans tell."""
ASTRAY = 10.0
"""Distance (m) driven in doubt from which scouts go anywhere without being told to."""
SLIP = 0.02
"""Probability that odometry failed altogether, where a scan calls for scouts."""
MOST = 0.02
"""Share of the belief that scouts are given at one scan at most."""


class Trust:
    """Whether scans fit as they used to: the share of beams the map explains against its own average.

    Attributes:
        driven: Distance (m) since the last scan that fitted.
        astray: Distance (m) driven in doubt against a much slower average, less what was driven without.
    """

    DECAY, SLOW_DECAY = 0.05, 0.005
    LEAST = 0.3

    def __init__(self, wary: bool) -> None:
        """A wary one doubts sooner, and does not take doubtful scans for the new usual."""
        self._usual: Optional[float] = None
        self._wary, self._low = wary, 0.85 if wary else 0.75
        self._long_usual: Optional[float] = None
        self.driven = self.astray = 0.0

    def is_lost(self, explained: float, driven: float) -> bool:
        """Take the share of one scan and the distance (m) to it; tell whether it is clearly below the usual."""
        usual = explained if self._usual is None else self._usual
        doubtful = explained < max(self.LEAST, self._low * usual)
        self.driven = self.driven + driven if doubtful else 0.0
        self._long_usual = max(usual, explained) if self._long_usual is None else self._long_usual
        self.astray = max(0.0, self.astray + (driven if explained < self._low * self._long_usual else -driven))
        self._long_usual += self.SLOW_DECAY * (explained - self._long_usual)
        self._usual = usual if doubtful and self._wary else usual + self.DECAY * (explained - usual)
        return doubtful


@dataclass(frozen=True)
class Found:
    """What scouts found.

    Attributes:
        poses: Particles, shape (F, 3).
        log_weights: Shape (F,): log of prior over proposal, the scan not yet in it.
        likelihoods: Shape (F,): log-likelihood of the scan.
        explained: Largest share of the beams that the map explains at one of the places.
    """

    poses: np.ndarray
    log_weights: np.ndarray
    likelihoods: np.ndarray
    explained: float

    def join(self, poses: np.ndarray, log_weights: np.ndarray, credit: float) -> Tuple[np.ndarray, np.ndarray]:
        """Return particles and their log-weights, the scan in them, with these added; `credit` is the scan's."""
        own = self.log_weights + credit * self.likelihoods
        excess = log_sum_exp(own) - log_sum_exp(log_weights) - math.log(MOST / (1.0 - MOST))
        return np.vstack((poses, self.poses)), np.concatenate((log_weights, own - max(0.0, excess)))


class Scouts:
    """Looks for places where the map explains clearly more of a scan."""

    def __init__(self, likelihood: ScanLikelihood, random_poses: RandomPoses) -> None:
        self._likelihood = likelihood
        self._random_poses = random_poses

    def search(
        self, belief: PoseGaussian, endpoints: np.ndarray, explained: float, driven: float, anywhere: bool, gain: float,
        count: int, rng: np.random.Generator,
    ) -> Optional[Found]:
        """Return particles at places that fit clearly better, None where there are none.

        Args:
            belief: Where the robot was thought to be before this scan.
            endpoints: The scan, shape (B, 2), in the base's frame.
            explained: Share of the beams that the map explains where the robot is thought to be now.
            driven: Distance (m) in doubt.
            anywhere: Look all over the map, not only around the belief.
            gain: How much more must be explained.
            count: How many particles to return.
            rng: Where chance comes from.
        """
        wide, starts = belief.widened(BASE + PER_METRE * driven), STARTS
        scouts = wide.sample(SCOUTS, rng)
        if anywhere:
            wide, starts = belief.widened(ANYWHERE), STARTS_ANYWHERE
            scouts = np.vstack((scouts, self._random_poses(SCOUTS_ANYWHERE)))
        values = self._likelihood.log(scouts, thin_out(endpoints, SCOUT_BEAMS))
        modes = self._likelihood.modes(scouts[apart(scouts, values, starts, 0.2, 0.1)], wide, endpoints)
        better = modes.explained > explained + gain
        if not better.any():
            return None
        modes = modes.only(better)
        around = mixture_around(modes)
        poses = around.sample(count, rng)
        log_weights = math.log(SLIP / count) + wide.log_density(poses) - around.log_density(poses)
        return Found(poses, log_weights, self._likelihood.log(poses, endpoints), float(modes.explained.max()))
