"""The robust form of the filter: a proposal that uses the scan, and rival hypotheses.

predict    particles and rivals are moved by odometry
correct    particles are drawn where prior and scan agree; rivals are corrected; all hypotheses are weighted by the scan
watch      from a reliable pose, changed blocks of the map are detected
doubt      where scans stop fitting, rivals are searched: nearby, where odometry may have slipped; then anywhere
decide     a rival with better evidence over several scans takes over
"""

from __future__ import annotations

import math
from typing import Dict, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.beams import Beams
from mbf_relay.localization.changed_blocks import ChangedBlocks
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.estimate import Moments, deviation_of, mean_and_covariance
from mbf_relay.localization.evidence import Evidence, Seen
from mbf_relay.localization.gaussians import PoseGaussian, log_sum_exp, normalized
from mbf_relay.localization.hypotheses import FITS, Hypotheses
from mbf_relay.localization.lever_arm import LeverArm
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.scan_likelihood import Modes, ScanLikelihood, apart, thin_out
from mbf_relay.localization.scan_proposal import ScanProposal, Weigh
from mbf_relay.localization.scan_search import Places, ScanSearch

FEWEST_BEAMS = 5
"""Returns below which a scan is not used to correct the pose."""
DRAWN_ANEW = 500
"""Particles drawn around a hypothesis that takes over."""
METRES_PER_RADIAN = 0.5
"""Distance (m) that a turn of one radian counts as."""
NEARBY, STARTS = 6000, 8
"""Poses sampled in a search nearby, and the best of them that are refined."""
SLIP = np.array([0.25, 0.25, 0.15])
SLIP_PER_METRE = np.array([0.3, 0.3, 0.1])
"""Standard deviations (m, m, rad) of a slip, and what each metre driven in doubt adds to them."""
GAIN = 0.05
"""Share of the beams that a new rival must explain more than the held pose does."""
AGAIN_NEARBY, AGAIN_ANYWHERE = 0.4, 3.0
"""Distance (m) from one search to the next, nearby and anywhere."""
ASTRAY, LOG_CARRIED = 3.0, -14.0
"""Distance (m) driven in doubt before a search anywhere, and the prior log-odds that the robot was carried."""
RECOVERING_ASTRAY, RECOVERING_LOG_CARRIED = 0.5, -7.0
"""The same with recovery_alpha_fast above 0, by which the user says that the robot is carried at times."""
WRONG = 0.05
"""Probability of being right below which a pose is in doubt, however well the newest scan fits."""
ANYWHERE = np.array([100.0, 100.0, 10.0])
"""Standard deviations (m, m, rad) of the prior in a search on the whole map: practically flat."""
START_MARGIN = 0.2
"""How far below the best score, 0 to 1, a place's may be for it to become a hypothesis in a global search."""
VIEW = 1.0
"""Distance (m) after which a lidar's scan counts in full. Closer ones hit the same walls and have the same errors where
the map lacks some: counted in full every few centimetres, they would make the filter overconfident and wrong."""
STANDING = 0.02
"""Smallest distance (m) that a scan counts as."""
BELIEVED = 0.8
"""Reliability from which on changes of the map are counted. With a third of the walls missing, a right pose has 0.9."""


class Doubt:
    """Detects scans that fit worse than usual, by the share of beams that the map explains.

    Attributes:
        way: Distance (m) driven in doubt, less that driven without since; 0 or more.
        LEARNT_OVER: Distance (m) over which the usual share is averaged.
        LOW: Factor on the usual share below which a scan is doubtful.
        LEAST: Share below which any scan is doubtful.
    """

    LEARNT_OVER, LOW, LEAST = 20.0, 0.75, 0.3

    def __init__(self) -> None:
        self._usual: Optional[float] = None
        self.way = 0.0

    def update(self, explained: float, way: float, right: float) -> bool:
        """Take a scan and return whether the pose is in doubt.

        Args:
            explained: Share of the beams that the map explains, 0 to 1.
            way: Distance (m) driven since the last scan.
            right: Probability, 0 to 1, that the pose is right; below WRONG it is in doubt anyway.
        """
        usual = explained if self._usual is None else self._usual
        doubtful = explained < max(self.LEAST, self.LOW * usual) or right < WRONG
        self.way = max(0.0, self.way + (way if doubtful else -way))
        self._usual = usual + min(1.0, way / self.LEARNT_OVER) * (explained - usual)
        return doubtful


class Corrected(NamedTuple):
    """Particles after a scan.

    Attributes:
        poses: Shape (N, 3).
        log_weights: Shape (N,), of weights that sum to one.
        weights: Shape (N,).
        log_likelihood: Log of the weighted mean over particles of the whole scan's likelihood.
        pose: Pose to publish, where the scan fits best, shape (3,); None where it has too few returns or a rival took
            over.
        news: Weight of the scan, 0 to 1: how much of it is independent of earlier scans.
        moments: Mean and covariance of the particles, where they were computed.
    """

    poses: np.ndarray
    log_weights: np.ndarray
    weights: np.ndarray
    log_likelihood: float
    pose: Optional[np.ndarray]
    news: float
    moments: Optional[Moments] = None


class HypothesisTracker:
    """The robust form of the filter, except for the motion of particles and resampling.

    Attributes:
        hypotheses: The held hypothesis and its rivals.
        lever_arm: Estimate of the lever arm.
        blocks: Changed blocks of the map.
        searched: Share, 0 to 1, of the promising blocks that the last global search examined before its limit.
    """

    def __init__(self, field: DistanceField, parameters: LocalizerParameters) -> None:
        """Begin on a map; with recovery_alpha_fast above 0 the whole map is searched soon after scans stop fitting."""
        self.hypotheses = Hypotheses()
        self.lever_arm = LeverArm()
        self.searched = 1.0
        self._set_up(field, parameters)
        self.start()

    def _set_up(self, field: DistanceField, parameters: LocalizerParameters) -> None:
        sigma_hit = parameters.laser_sigma_hit
        self._field = field
        self._likelihood = ScanLikelihood(field, sigma_hit)
        self._proposal = ScanProposal(self._likelihood)
        self._evidence = Evidence(field, sigma_hit)
        self._search: Optional[ScanSearch] = None
        self._recovers = parameters.recovery_alpha_fast > 0.0
        self._semi_static = parameters.semi_static
        self.blocks = ChangedBlocks(field, parameters.changed_block_size, sigma_hit)

    def change(self, field: DistanceField, parameters: LocalizerParameters, same_map: bool) -> None:
        """Take other parameters or another map; on another one rivals, evidence and changed blocks are dropped."""
        evidence, blocks = self._evidence, self.blocks
        self._set_up(field, parameters)
        if same_map:
            self._evidence.go_on_from(evidence)
            self.blocks.go_on_from(blocks)
        else:
            self.start(self._anywhere)

    def start(self, anywhere: bool = False) -> None:
        """Start again, around the particles given next or, by a global search with the next scan, anywhere."""
        self.hypotheses.clear()
        self.lever_arm.forget_pose()
        self._told: Optional[np.ndarray] = None  # the pose published last, moved by odometry since
        self._doubt = Doubt()
        self._anywhere = anywhere
        self._ways: Dict[str, float] = {}  # (m) since each lidar's last scan that was used
        self._looked: Dict[str, float] = {}  # (m) since each lidar's last scan, used or not
        self._way = 0.0  # (m) since the last scan of any lidar that was used
        self._since_nearby = self._since_anywhere = 0.0
        self.blocks.forget()

    def predict(self, step: Pose2D, noise: np.ndarray, shown: float = 0.0) -> None:
        """Move all hypotheses by a step of odometry.

        Args:
            step: In the base's frame before it.
            noise: Covariance of the step, shape (3, 3), in the base's frame.
            shown: Smallest distance (m) the robot has moved, by the scans.
        """
        way = max(shown, float(np.hypot(step.x, step.y)) + METRES_PER_RADIAN * abs(step.theta))
        self._way += way
        for ways in (self._ways, self._looked):
            for lidar in ways:
                ways[lidar] += way
        self._since_nearby += way
        self._since_anywhere += way
        if self._told is not None:
            self._told = np.array(Pose2D(*self._told).compose(step))
        self.hypotheses.predict(step, noise, way)

    def correct(
        self, poses: np.ndarray, log_weights: np.ndarray, beams: Beams, lidar: str, rng: np.random.Generator,
        is_news: bool = False, weigh: Optional[Weigh] = None,
    ) -> Corrected:
        """Correct particles and hypotheses by a scan.

        Args:
            poses: Particles as odometry moved them, shape (N, 3).
            log_weights: Shape (N,).
            beams: Of the scan, all of them.
            lidar: Frame of the lidar; the scan's weight depends on the distance since its last one.
            rng: Random generator.
            is_news: Whether the scan counts in full anyway, as on a user's request.
            weigh: Returns log-likelihoods of the scan for particles; the tempered likelihood field where None.
        """
        seen = Seen.of(beams)
        way, self._looked[lidar] = min(self._way, self._looked.get(lidar, self._way)), 0.0
        if len(seen.ends) < FEWEST_BEAMS:  # self._way stays, for a lidar with enough returns
            self._look_at_silence(poses, log_weights, seen, way)
            return Corrected(poses, *normalized(log_weights), None, min(1.0, way / VIEW))
        self._way = 0.0
        is_news = is_news or lidar not in self._ways
        news = 1.0 if is_news else min(1.0, max(self._ways[lidar], STANDING) / VIEW)
        since, self._ways[lidar] = self._ways.get(lidar, 0.0), 0.0
        if self._anywhere:
            started = self._start_anywhere(seen)
            if started is not None:
                poses, log_weights = drawn_around(started, rng)
        weighed = self._unchanged(poses, log_weights, seen.ends) if self._semi_static else seen.ends
        proposed = self._proposal.propose(poses, log_weights, weighed, news, rng, weigh)
        held = proposed.best
        self.lever_arm.correct(proposed.prior, held)
        judged = self.hypotheses.correct(held.mean, self._likelihood, self._evidence, seen, way, since, news)
        if self._doubt.update(proposed.explained, way, self.hypotheses.fit.right):
            self._look_for_rivals(held, proposed.explained, seen.ends, rng)
        else:
            self._evidence.learn(proposed.explained, way)
            if self.hypotheses.fit.right >= FITS:
                self._evidence.learn_grazing(judged, way)
        winner = self.hypotheses.challenge(held)
        if winner is not None:
            self._doubt.way = 0.0
            self.lever_arm.forget_pose()
            self._told = None
            self.blocks.forget()  # they were counted from the pose that was wrong
            poses, log_weights = drawn_around(winner, rng)
            return Corrected(poses, *normalized(log_weights), None, news)
        moments = mean_and_covariance(proposed.poses, proposed.weights)
        if self._reliability(moments) >= BELIEVED:
            self.blocks.update(held.mean, seen.ends, seen.laser, news)
        starts = held.mean[None] if self._told is None else np.stack((held.mean, self._told))
        self._told = self._likelihood.sharpest(starts, proposed.prior, weighed)
        return Corrected(*proposed[:4], self._told, news, moments)

    def reliability(self, poses: np.ndarray, log_weights: np.ndarray) -> float:
        """Return the probability that the hypothesis held by particles, shape (N, 3), is right."""
        return self._reliability(moments_of(poses, log_weights))

    def _reliability(self, moments: Moments) -> float:
        return self.hypotheses.reliability(deviation_of(moments[1]))

    def _unchanged(self, poses: np.ndarray, log_weights: np.ndarray, endpoints: np.ndarray) -> np.ndarray:
        """Return a scan's ends without those in changed blocks; all of them where the pose is not reliable.

        Rivals, evidence and reliability use all ends; otherwise a wrong pose would remove the evidence against itself.
        """
        if self.reliability(poses, log_weights) < BELIEVED:
            return endpoints
        mean, _ = mean_and_covariance(poses, np.exp(log_weights - log_sum_exp(log_weights)))
        kept = endpoints[~self.blocks.holds(np.array(mean), endpoints)]
        return np.ascontiguousarray(kept) if len(kept) >= FEWEST_BEAMS else endpoints

    def find(self, hits: np.ndarray, margin: float = START_MARGIN) -> Places:
        """Return all places on the map where a scan with ends at `hits`, shape (B, 2), fits nearly as well as anywhere.
        """
        if self._search is None:
            self._search = ScanSearch(self._field)
        places = self._search.search(hits, margin=margin)
        self.searched = places.searched
        return places

    def _look_at_silence(self, poses: np.ndarray, log_weights: np.ndarray, seen: Seen, way: float) -> None:
        """Update the reliability by a scan with too few returns: by silent beams that pass through mapped obstacles."""
        mean, _ = mean_and_covariance(poses, np.exp(log_weights - log_sum_exp(log_weights)))
        through = seen.silence * float(self._evidence.silent_through(np.array([mean]), seen)[0])
        fit = self.hypotheses.fit
        if through > 0.0:
            fit.update(fit.hits, through, way)

    def _start_anywhere(self, seen: Seen) -> Optional[PoseGaussian]:
        """Start with all places where a scan fits as hypotheses; return the best, None where there is none."""
        modes = self._anywhere_modes(seen.ends, START_MARGIN)
        if modes is None:
            return None
        self._anywhere = False
        judged = self._evidence.judge(modes.poses, seen)
        return self.hypotheses.start(
            [PoseGaussian(pose, covariance) for pose, covariance in zip(modes.poses, modes.covariances)],
            judged.log_likelihoods,
        )

    def _anywhere_modes(self, endpoints: np.ndarray, margin: float) -> Optional[Modes]:
        places = self.find(endpoints, margin)
        if len(places.poses) == 0:
            return None
        prior = PoseGaussian(places.poses[0], np.diag(ANYWHERE ** 2))
        return self._likelihood.modes(places.poses, prior, endpoints)

    def _look_for_rivals(
        self, held: PoseGaussian, explained: float, endpoints: np.ndarray, rng: np.random.Generator
    ) -> None:
        """Search for rivals where odometry may have slipped to and, after metres in doubt, on the whole map."""
        if self._since_nearby >= AGAIN_NEARBY:
            self._since_nearby = 0.0
            wide = held.widened(SLIP + SLIP_PER_METRE * self._doubt.way)
            starts = wide.sample(NEARBY, rng)
            values = self._likelihood.log(starts, thin_out(endpoints, 60))
            modes = self._likelihood.modes(starts[apart(starts, values, STARTS, 0.2, 0.1)], wide, endpoints)
            self._add(modes, explained, held, -math.inf)
        astray, log_carried = (
            (RECOVERING_ASTRAY, RECOVERING_LOG_CARRIED) if self._recovers else (ASTRAY, LOG_CARRIED)
        )
        lost = self._doubt.way >= astray and (self._recovers or self.hypotheses.fit.right < WRONG)
        if lost and self._since_anywhere >= AGAIN_ANYWHERE:
            self._since_anywhere = 0.0
            found = self._anywhere_modes(endpoints, START_MARGIN)
            if found is not None:
                self._add(found, explained, held, log_carried)

    def _add(self, modes: Modes, explained: float, held: PoseGaussian, log_carried: float) -> None:
        better = modes.explained > explained + GAIN
        if better.any():
            modes = modes.only(better)
            self.hypotheses.add(modes.poses, modes.covariances, held.mean, log_carried)


def moments_of(poses: np.ndarray, log_weights: np.ndarray) -> Moments:
    """Return mean and covariance of particles, (N, 3) and (N,)."""
    return mean_and_covariance(poses, np.exp(log_weights - log_weights.max()))


def drawn_around(belief: PoseGaussian, rng: np.random.Generator) -> Tuple[np.ndarray, np.ndarray]:
    """Return DRAWN_ANEW particles around a belief, shape (N, 3), and their equal log-weights, (N,)."""
    return belief.sample(DRAWN_ANEW, rng), np.full(DRAWN_ANEW, -np.log(DRAWN_ANEW))
