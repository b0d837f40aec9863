"""Multi-hypothesis tracking: other poses the robot may have, each with the evidence of all scans since it was found.

The particles represent one hypothesis, the held one. Where scans stop fitting, odometry may have slipped or the robot
may have been carried; after a global start many places may look alike. Each such place is a *rival*: a normal
distribution that moves with odometry, is corrected by scans, and accumulates evidence (Jensfelt and Kristensen 2001).
It starts at the prior odds of a slip or of having been carried, without the scan that it was found by. It replaces the
held hypothesis when its evidence is better over several scans and some distance; a single scan is never enough. The
replaced one becomes a rival and may come back. Each keeps its own probability of being right, by how scans fitted
there. As the robot is in one place only, two places that both fit are each half as likely.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import List, Optional

import numpy as np

from mbf_relay.geometry import Pose2D, angle_between
from mbf_relay.localization.evidence import Evidence, Judgement, Seen
from mbf_relay.localization.gaussians import PoseGaussian, log_sum_exp
from mbf_relay.localization.reliability import RIGHT_TURN, RIGHT_WITHIN, Reliability, within
from mbf_relay.localization.scan_likelihood import ScanLikelihood

MOST = 100
"""Largest number of rivals."""
FORGOTTEN = -16.0
"""Log-odds against the held hypothesis below which a rival is dropped, unless it is on trial or scans fit there."""
FITS = 0.5
"""Probability of being right, rivals not considered, above which scans count as fitting."""
SAME_PLACE, SAME_HEADING = 0.3, 0.2
"""Distance (m) and turn (rad) below which two hypotheses are merged."""
PROVEN_SCANS, PROVEN_WAY = 3, 1.0
"""Trial: scans and distance (m) before a rival can take over, and during which it is not dropped: of many places found
at once each starts with small odds, the right one included."""
LEAD = 2.0
"""Log-odds by which a rival must lead to take over, so that equal ones do not alternate."""
WAY_OF_A_SCAN = 3.0
"""Distance (m) after which a scan counts in full as evidence: closer ones hit the same walls with the same errors."""
LOG_SLIPPED, SLIP_SIZE = math.log(0.02), 0.3
"""Log-odds that odometry slipped, given a scan that does not fit; mean (m) of a slip, exponentially distributed."""


@dataclass(eq=False)
class Hypothesis:
    """A pose the robot may have.

    Attributes:
        belief: Distribution of the pose, in the map's frame.
        log_weight: Log of its share of the total belief.
        scans: Number of scans since it was found.
        way: Distance driven (m) since then, turns included.
        fit: How well scans fitted there since, as a probability that it is right.
    """

    belief: PoseGaussian
    log_weight: float
    scans: int = 0
    way: float = 0.0
    fit: Reliability = field(default_factory=Reliability)

    @property
    def on_trial(self) -> bool:
        """Whether it has had fewer than PROVEN_SCANS scans or less than PROVEN_WAY."""
        return self.scans < PROVEN_SCANS or self.way < PROVEN_WAY


class Hypotheses:
    """The hypothesis held by the particles, and its rivals.

    Attributes:
        held: Log of the held hypothesis' share of the total belief.
        fit: How well scans fitted at the held one.
        at: Its pose, shape (3,), in the map's frame; zero before the first scan.
        rivals: All other hypotheses.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Drop all rivals and what is known of the held hypothesis."""
        self.held, self.fit, self.at = 0.0, Reliability(), np.zeros(3)
        self.rivals: List[Hypothesis] = []

    @property
    def share_held(self) -> float:
        """The held hypothesis' share of the total belief, 0 to 1."""
        return math.exp(self.held)

    def reliability(self, deviation: float) -> float:
        """Return the probability, 0 to 1, that the held pose is right; at most one hypothesis is.

        Rivals reduce it in one of two ways, whichever gives less: by their shares of the belief, which err where walls
        are missing on the map at one place and not at the other, or by how well scans fit at each.

        Args:
            deviation: Standard deviation (m) of the held position, per axis.
        """
        own, elsewhere = odds(self.fit.right), 0.0
        for rival in self.rivals:
            if is_same(rival.belief.mean, self.at, RIGHT_WITHIN, RIGHT_TURN):
                own += odds(rival.fit.right)
            elif rival.scans > 0:
                elsewhere += odds(rival.fit.right)
        return within(deviation) * min(self.share_held * self.fit.right, own / (1.0 + own + elsewhere))

    def predict(self, step: Pose2D, noise: np.ndarray, way: float) -> None:
        """Move all hypotheses by odometry; step and noise as for `PoseGaussian.moved`, `way` is the distance (m)."""
        self.at = np.array(Pose2D(*map(float, self.at)).compose(step))
        for rival in self.rivals:
            rival.belief = rival.belief.moved(step, noise)
            rival.way += way

    def correct(
        self,
        held: np.ndarray,
        likelihood: ScanLikelihood,
        evidence: Evidence,
        seen: Seen,
        way: float,
        since: float,
        news: float,
    ) -> Judgement:
        """Correct all rivals by a scan, and weight all hypotheses by it.

        Args:
            held: Pose of the held hypothesis after the scan, shape (3,).
            likelihood: Likelihood of scans, by which the rivals are corrected.
            evidence: Computes the evidence for each pose.
            seen: Parts of the scan.
            way: Distance (m) driven since the last scan.
            since: Distance (m) driven since the last scan of this lidar.
            news: Weight of the scan, 0 to 1: how much of it is independent of earlier scans.

        Returns:
            The evidence for the held pose, followed by the rivals' in the order they had at the call.
        """
        for rival in self.rivals:
            modes = likelihood.modes(rival.belief.mean[None, :], rival.belief, seen.ends, news)
            rival.belief = PoseGaussian(modes.poses[0], modes.covariances[0])
            rival.scans += 1
        poses = np.array([held] + [rival.belief.mean for rival in self.rivals])
        judged = evidence.judge(poses, seen)
        for fit, hits, through in zip([self.fit] + [r.fit for r in self.rivals], judged.hits, judged.through):
            fit.update(float(hits), float(through), way)
        logs = judged.log_likelihoods * min(1.0, since / WAY_OF_A_SCAN)
        self.held += float(logs[0])
        for rival, log in zip(self.rivals, logs[1:]):
            rival.log_weight += float(log)
        self._tidy(held)
        return judged

    def add(self, poses: np.ndarray, covariances: np.ndarray, held: np.ndarray, log_carried: float = -math.inf) -> None:
        """Add rivals found by one scan, which share the prior odds of a slip of that size or of having been carried.

        Args:
            poses: Shape (K, 3); those where there is a hypothesis already are left out.
            covariances: Shape (K, 3, 3).
            held: Pose of the held hypothesis, shape (3,).
            log_carried: Log-odds that the robot was carried, to any place.
        """
        known = [held] + [rival.belief.mean for rival in self.rivals]
        new = [i for i, pose in enumerate(poses) if not any(is_same(pose, other) for other in known)]
        for i in new:
            slip = math.hypot(poses[i][0] - held[0], poses[i][1] - held[1]) / SLIP_SIZE
            log_weight = self.held + max(LOG_SLIPPED - slip, log_carried) - math.log(len(new))
            belief = PoseGaussian(poses[i], covariances[i])
            self.rivals.append(Hypothesis(belief, log_weight, fit=Reliability(chosen=True)))
        self._tidy(held)

    def start(self, beliefs: List[PoseGaussian], log_weights: np.ndarray) -> PoseGaussian:
        """Start with hypotheses of given log-weights, shape (K,); return the best, which becomes the held one."""
        best = int(np.argmax(log_weights))
        self.held = float(log_weights[best])
        self.rivals = [
            Hypothesis(belief, float(log), PROVEN_SCANS)
            for i, (belief, log) in enumerate(zip(beliefs, log_weights))
            if i != best
        ]
        self._tidy(beliefs[best].mean)
        return beliefs[best]

    def challenge(self, held: PoseGaussian) -> Optional[PoseGaussian]:
        """Let the best rival not on trial take over if it leads by LEAD; return its belief, None where none does."""
        proven = [rival for rival in self.rivals if not rival.on_trial]
        best = max(proven, key=lambda rival: rival.log_weight, default=None)
        if best is None or best.log_weight < self.held + LEAD:
            return None
        self.rivals.remove(best)
        self.rivals.append(Hypothesis(held, self.held, PROVEN_SCANS, PROVEN_WAY, self.fit))
        self.held, self.fit, self.at = best.log_weight, best.fit, best.belief.mean
        return best.belief

    def _tidy(self, held: np.ndarray) -> None:
        """Merge hypotheses at the same place, drop rivals of negligible weight, and normalize the weights."""
        kept: List[Hypothesis] = []
        for rival in sorted(self.rivals, key=lambda one: -one.log_weight):
            places = [(held, self.fit)] + [(one.belief.mean, one.fit) for one in kept]
            same = next((fit for place, fit in places if is_same(rival.belief.mean, place)), None)
            if same is not None:
                same.right = max(same.right, rival.fit.right if rival.scans > 0 else 0.0)
            elif len(kept) < MOST and (
                rival.on_trial or rival.log_weight > self.held + FORGOTTEN or rival.fit.right > FITS
            ):
                kept.append(rival)
        self.rivals, self.at = kept, np.array(held)
        total = log_sum_exp(np.array([self.held] + [rival.log_weight for rival in kept]))
        self.held -= total
        for rival in kept:
            rival.log_weight -= total


def is_same(
    pose: np.ndarray, other: np.ndarray, distance: float = SAME_PLACE, turn: float = SAME_HEADING
) -> bool:
    """Return whether two poses, shape (3,), are less than `distance` (m) and `turn` (rad) apart."""
    near = math.hypot(pose[0] - other[0], pose[1] - other[1]) < distance
    return near and abs(angle_between(other[2], pose[2])) < turn


def odds(probability: float) -> float:
    """Return the odds that a probability below 1 stands for."""
    return probability / (1.0 - probability)
