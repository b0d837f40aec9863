"""Rival hypotheses: other places the robot may be, each with the evidence of all scans since it came up.

The particles hold one hypothesis. Where scans stop fitting, odometry may have slipped or the robot may have been
carried; where it was started anywhere, many places may look alike. Each such place is a normal distribution of its own
that moves with odometry, is pulled to where scans fit, and gathers evidence (Jensfelt and Kristensen 2001). It enters
at the prior odds of a slip or of having been carried; the scan that brought it up is not counted. It replaces the
hypothesis held when it has the better evidence over several scans and some distance: never on one scan, since something
always looks like something else. The one replaced becomes a rival and may come back. Each keeps its own probability of
being right, by how scans fitted where it was; but the robot is in one place only, so that two places that both fit are
each half as likely, however sure either would be alone.
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
"""Rivals kept at most."""
FORGOTTEN = -16.0
"""Log-odds against the hypothesis held below which a rival that is not on trial is dropped, unless scans fit there."""
FITS = 0.5
"""Probability of being right, others aside, from which scans fit."""
SAME_PLACE, SAME_HEADING = 0.3, 0.2
"""Distance (m) and turn (rad) within which two hypotheses are one."""
PROVEN_SCANS, PROVEN_WAY = 3, 1.0
"""Scans and way (m) a rival has to prove itself on before it can take over, and until which none is given up: of many
places found at once, each enters at small odds, the right one too."""
LEAD = 2.0
"""Log-odds a rival needs to take over, so that equals do not take turns."""
WAY_OF_A_SCAN = 3.0
"""Way (m) after which a scan tells something new: those taken on the way hit the same walls by the same errors."""
LOG_SLIPPED, SLIP_SIZE = math.log(0.02), 0.3
"""Log-odds that odometry slipped, where a scan makes one ask; mean size (m) of a slip, whose tail is exponential."""


@dataclass(eq=False)
class Hypothesis:
    """A place the robot may be.

    Attributes:
        belief: Where exactly.
        log_weight: Log of its share of the belief.
        scans: Since it came up.
        way: Metres driven since.
        fit: How scans fitted there since, and with that the probability that it is right.
    """

    belief: PoseGaussian
    log_weight: float
    scans: int = 0
    way: float = 0.0
    fit: Reliability = field(default_factory=Reliability)

    @property
    def on_trial(self) -> bool:
        """Whether it has not yet had the scans and the way in which to prove itself."""
        return self.scans < PROVEN_SCANS or self.way < PROVEN_WAY


class Hypotheses:
    """The rivals of the hypothesis the particles hold.

    Attributes:
        held: Log of the share of the belief the particles hold.
        fit: How scans fitted at the one they hold.
        at: Where that is, shape (3,).
        rivals: All others.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all rivals, and how scans fitted."""
        self.held, self.fit, self.at = 0.0, Reliability(), np.zeros(3)
        self.rivals: List[Hypothesis] = []

    @property
    def share_held(self) -> float:
        """Share of the belief, 0 to 1, that the particles hold."""
        return math.exp(self.held)

    def reliability(self, deviation: float) -> float:
        """Return the probability that the pose held is right, which no more than one of the hypotheses is.

        Its share beside the rivals is the smaller of two: by the evidence since they came up, which errs where the map
        lacks walls at one place and not at the other, and by how well scans fit at each.

        Args:
            deviation: Of its position (m), of one axis.
        """
        own, elsewhere = odds(self.fit.right), 0.0
        for rival in self.rivals:
            if is_same(rival.belief.mean, self.at, RIGHT_WITHIN, RIGHT_TURN):
                own += odds(rival.fit.right)
            elif rival.scans > 0:
                elsewhere += odds(rival.fit.right)
        return within(deviation) * min(self.share_held * self.fit.right, own / (1.0 + own + elsewhere))

    def predict(self, step: Pose2D, noise: np.ndarray, way: float) -> None:
        """Move the one held and all rivals by a motion of `way` metres; step and noise are as `PoseGaussian.moved`'s.
        """
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
        """Pull all rivals to where a scan fits, and weigh them and the one held by it.

        Args:
            held: Pose of the hypothesis held, the scan already in it, shape (3,).
            likelihood: Of scans, to climb on.
            evidence: Judges the poses.
            seen: Of the scan.
            way: Metres driven since the last scan.
            since: Metres driven since the last scan of this lidar.
            news: Share of the scan, 0 to 1, that earlier ones have not told.

        Returns:
            What the scan says of the pose held, and then of the rivals.
        """
        for rival in self.rivals:
            modes = likelihood.modes(rival.belief.mean[None, :], rival.belief, seen.ends, news)
            rival.belief = PoseGaussian(modes.poses[0], modes.covariances[0])
            rival.scans += 1
        poses = np.array([held] + [rival.belief.mean for rival in self.rivals])
        judged = evidence.judge(poses, seen)
        for fit, hits, through in zip([self.fit] + [r.fit for r in self.rivals], judged.hits, judged.through):
            fit.look(float(hits), float(through), way)
        logs = judged.log_likelihoods * min(1.0, since / WAY_OF_A_SCAN)
        self.held += float(logs[0])
        for rival, log in zip(self.rivals, logs[1:]):
            rival.log_weight += float(log)
        self._tidy(held)
        return judged

    def add(self, poses: np.ndarray, covariances: np.ndarray, held: np.ndarray, log_carried: float = -math.inf) -> None:
        """Add rivals at the prior odds of so large a slip, or of having been carried; those of one scan share them.

        Args:
            poses: Places, shape (K, 3); only those that none holds yet are new.
            covariances: Shape (K, 3, 3).
            held: Pose of the hypothesis held, shape (3,).
            log_carried: Log-odds that the robot was carried, which may be to anywhere.
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
        """Begin with hypotheses of given log-weights, shape (K,); return the best, which is held from now on."""
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
        """Return the rival that has proven itself against the one held, which becomes a rival; None where none has."""
        proven = [rival for rival in self.rivals if not rival.on_trial]
        best = max(proven, key=lambda rival: rival.log_weight, default=None)
        if best is None or best.log_weight < self.held + LEAD:
            return None
        self.rivals.remove(best)
        self.rivals.append(Hypothesis(held, self.held, PROVEN_SCANS, PROVEN_WAY, self.fit))
        self.held, self.fit, self.at = best.log_weight, best.fit, best.belief.mean
        return best.belief

    def _tidy(self, held: np.ndarray) -> None:
        """Merge what has become one place, drop what has no weight to speak of, and normalise."""
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
    """Return whether two poses, shape (3,), are one place: less than `distance` (m) and `turn` (rad) from each other.
    """
    near = math.hypot(pose[0] - other[0], pose[1] - other[1]) < distance
    return near and abs(angle_between(other[2], pose[2])) < turn


def odds(probability: float) -> float:
    """Return the odds that a probability below 1 stands for."""
    return probability / (1.0 - probability)
