"""The particle filter: Monte Carlo localization as amcl runs it (Augmented MCL, table 8.3), without ROS."""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import Dict, List, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, angle_between, normalize_angles
from mbf_relay.localization.beams import Beams, is_hit, limits_of, pick_beams
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.estimate import Estimate, Moments, estimate, mean_and_covariance
from mbf_relay.localization.gaussians import log_sum_exp
from mbf_relay.localization.initial_pose import check_initial_pose
from mbf_relay.localization.laser_models import is_converged, make_laser_model
from mbf_relay.localization.lever_arm import spread
from mbf_relay.localization.motion_models import make_motion_model
from mbf_relay.localization.odometry_watch import OdometryWatch
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.resampling import AverageLikelihood, particle_limits, replicate, resample
from mbf_relay.localization.scan_search import Places
from mbf_relay.localization.tracker import FEWEST_BEAMS, Corrected, HypothesisTracker
from mbf_relay.maps import OccupancyMap
from mbf_relay.median import median
from mbf_relay.scan import LaserScan

OWN_MODEL = "likelihood_field"
"""The default laser model, in place of which the robust form uses `ScanLikelihood` with all beams."""
LEAST_SHOWN = 0.1
"""Change (m) of most beams above which the robot has moved though odometry shows no motion."""
STANDS = 0.1
"""Share of update_min_d and update_min_a up to which odometry counts as standing."""
FEWEST_PREDICTED = 1500
"""Smallest number of particles for the motion update, in the robust form; fewer are replicated to it."""
NO_NOISE = np.zeros((3, 3))
"""Covariance handed to rivals where there are none; particles are moved by the motion model."""


class Localizer:
    """Tracks the robot's pose on a map from odometry and laser scans.

    Not safe for several threads at once; whoever shares one holds a lock.

    Attributes:
        parameters: The values in force; change them by `reconfigure`.
        odometry: Detects resets of the odometry.
        field: Distance field of the map; change it by `set_map`.
        poses: Particles, shape (N, 3) as x, y (m), theta (rad), in the map's frame.
        log_weights: Shape (N,), logarithms of weights that sum to one.
        map_from_odom: The odometry frame in the map, None before the first estimate.
        last_estimate: The newest estimate, None before the first.
        log_likelihood: Log of the weighted mean over particles of the newest scan's likelihood, up to a constant of the
            model; None before the first.
        effective_particles: Effective sample size (Kong, Liu, Wong 1994) after that scan and before resampling; None
            before the first.
    """

    def __init__(self, parameters: LocalizerParameters, occupancy: OccupancyMap, rng: np.random.Generator) -> None:
        """Spread the particles over the map's free space, or leave them at its origin where it has none.

        Raises:
            ValueError: The map has no cell.
        """
        self._rng = rng
        self.parameters = parameters
        self.map_from_odom: Optional[Pose2D] = None
        self.last_estimate: Optional[Estimate] = None
        self.log_likelihood: Optional[float] = None
        self.effective_particles: Optional[float] = None
        self.poses: np.ndarray
        self.log_weights: np.ndarray
        self._odom_pose: Optional[Pose2D] = None
        self.odometry = OdometryWatch()
        # by the frame of each lidar of which a scan has counted since the robot moved: odometry where it stands since,
        # and the scan there
        self._stood: Dict[str, Tuple[Pose2D, LaserScan]] = {}
        self._updates = 0.0
        self._converged = False
        self.field = DistanceField(occupancy, parameters.laser_likelihood_max_dist)
        self._averages = AverageLikelihood()
        self._tracker = HypothesisTracker(self.field, parameters)
        self._make_models()
        self._start(np.zeros((1, 3)))
        if self.field.has_free_cells:
            self.globalize()

    # --- what a user asks for -------------------------------------------------------------------------------------

    def set_initial_pose(self, pose: Pose2D, covariance: np.ndarray) -> None:
        """Start again around a pose.

        Args:
            pose: Of the base, in the map's frame.
            covariance: Shape (3, 3) over x, y (m^2) and theta (rad^2).

        Raises:
            ValueError: The pose is not finite or not on the map, or the covariance is not finite. Nothing has changed.
        """
        check_initial_pose(pose, covariance, self.field.occupancy)
        variances, axes = np.linalg.eigh(0.5 * covariance + 0.5 * covariance.T)
        noise = self._rng.standard_normal((self.parameters.max_particles, 3)) * np.sqrt(np.maximum(variances, 0.0))
        self._start(noise @ axes.T + np.array(pose))

    def globalize(self) -> None:
        """Spread the particles evenly over the free space.

        Raises:
            ValueError: The map has no free cell. Nothing has changed.
        """
        self._start(self.field.random_free_poses(self.parameters.max_particles, self._rng))
        self._tracker.start(anywhere=True)

    def request_update(self) -> None:
        """Let the next scan update the filter even where the robot has not moved."""
        self._forced = True

    def change_odometry(self) -> None:
        """Expect odometry in another frame from the next scan on; the motion up to it is unknown, particles stay."""
        self.map_from_odom = self._odom_pose = None

    def set_map(self, occupancy: OccupancyMap) -> None:
        """Take another map; the particles stay where they are, and the next scan updates them.

        amcl starts again at the parameter server's pose, which is seconds old or the launch file's. A map equal to the
        present one is ignored: some nodes send it every second, and each time all rivals would be dropped.

        Raises:
            ValueError: The map has no cell. The old one stays.
        """
        if occupancy.is_same(self.field.occupancy):
            return
        self.field = DistanceField(occupancy, self.parameters.laser_likelihood_max_dist)
        self._averages.reset()
        self._make_models()
        self._tracker.change(self.field, self.parameters, same_map=False)
        self.request_update()

    def reconfigure(self, parameters: LocalizerParameters) -> None:
        """Take new parameters at once; particles stay, and rivals unless `robust` was switched on or off."""
        if parameters.laser_likelihood_max_dist != self.parameters.laser_likelihood_max_dist:
            self.field = DistanceField(self.field.occupancy, parameters.laser_likelihood_max_dist)
        is_robust, self.parameters = self.parameters.robust, parameters
        self._make_models()
        # rivals go along in the robust form alone
        self._tracker.change(self.field, parameters, same_map=is_robust and parameters.robust)

    @property
    def weights(self) -> np.ndarray:
        """Weights of the particles, shape (N,), sum one."""
        weights: np.ndarray = np.exp(self.log_weights)
        weights /= weights.sum()
        return weights

    def hypotheses(self) -> List[Tuple[Pose2D, float]]:
        """Return the hypotheses: poses with shares of the belief, heaviest first; empty before the first estimate."""
        if self.last_estimate is None:
            return []
        found = [(self.last_estimate.pose, self._tracker.hypotheses.share_held)]
        for rival in self._tracker.hypotheses.rivals:
            found.append((Pose2D(*map(float, rival.belief.mean)), math.exp(rival.log_weight)))
        return sorted(found, key=lambda one: -one[1])

    def reliability(self) -> Optional[float]:
        """Return the probability that the newest estimate is right within 0.5 m and 10 degrees.

        None before the first estimate, and with `robust` off.
        """
        if self.last_estimate is None or not self.parameters.robust:
            return None
        return self._tracker.reliability(self.poses, self.log_weights)

    def changed_blocks(self) -> OccupancyMap:
        """Return the changed blocks of the map as a map with a cell for each block: 100 changed, 0 not, -1 not seen.

        Only scans from reliable poses since the last start count; all -1 with `robust` off.
        """
        return self._tracker.blocks.as_map()

    def find(self, scan: LaserScan, laser_pose_in_base: Pose2D) -> Places:
        """Return all places on the map where a scan fits nearly as well as at the best one; changes nothing.

        Args:
            scan: The scan.
            laser_pose_in_base: Pose of the scan's frame in the base's frame.

        Raises:
            ValueError: The scan's limits leave nothing.
        """
        return self._tracker.find(self._all_beams(scan, laser_pose_in_base).hits)

    @property
    def searched(self) -> float:
        """Share, 0 to 1, of the promising blocks that the last global search examined before its limit."""
        return self._tracker.searched

    def fit(self, pose: Pose2D, scan: LaserScan, laser_pose_in_base: Pose2D) -> Optional[float]:
        """Return which share of a scan, 0 to 1, the map explains from a pose; None where nothing came back.

        Args:
            pose: Of the base, in the map's frame.
            scan: The scan.
            laser_pose_in_base: Pose of the scan's frame in the base's frame.

        Raises:
            ValueError: The scan's limits leave nothing.
        """
        return self.field.share_on_map(pose, self._all_beams(scan, laser_pose_in_base).hits)

    # --- the filter -----------------------------------------------------------------------------------------------

    def process(self, odom_pose: Pose2D, scan: LaserScan, laser_pose_in_base: Pose2D) -> Optional[Estimate]:
        """Take one scan.

        The filter is updated when the robot has moved far enough since the last update, when it was started anew, and
        when an update was requested; with several lidars, by the next scan of each. In the robust form also when most
        beams show that the robot has moved, be it that its odometry stands still, or that it was carried.

        Args:
            odom_pose: Of the base in the odometry frame, at the scan's time.
            scan: The scan.
            laser_pose_in_base: Pose of the scan's frame in the base's frame.

        Returns:
            The new estimate, or None where there was no update.

        Raises:
            ValueError: Odometry or scan hold nothing usable; the filter is as before.
        """
        if not odom_pose.is_finite():
            raise ValueError(f"odometry pose {tuple(odom_pose)} is not finite")
        self._follow_odometry(odom_pose, scan, laser_pose_in_base)
        if self._odom_pose is None or self._forced or self._has_moved(self._odom_pose, odom_pose):
            self._stood = {}
        shown = 0.0
        if scan.frame in self._stood:
            shown = self._shown_way(odom_pose, scan)
            if shown <= max(self.parameters.update_min_d, LEAST_SHOWN):
                return None
        beams = self._pick(scan, laser_pose_in_base)
        before = odom_pose if self._odom_pose is None else self._odom_pose
        if self._odom_pose is not None and self.last_estimate is not None:
            self._propagate(before, odom_pose, self.last_estimate.pose.theta, shown)
        pose = moments = None
        if self.parameters.robust:
            corrected = self._correct(scan, laser_pose_in_base, beams)
            self._updates, pose, moments = self._updates + corrected.news, corrected.pose, corrected.moments
            self.log_likelihood, weights = corrected.log_likelihood, corrected.weights
        else:
            self.log_likelihood = self._reweight(beams)
            self._updates += 1.0
            weights = self.weights
        self.effective_particles = 1.0 / float(np.square(weights).sum())
        # As in amcl the first scan after a start, which counts anyway, leaves a request to the second.
        self._forced = self._forced and self._odom_pose is None
        self._odom_pose = odom_pose
        self.last_estimate = self._estimate(weights, pose, moments)
        if self._updates >= self.parameters.resample_interval:
            self._updates = 0.0
            self._resample(weights)
        self.map_from_odom = self.last_estimate.pose.compose(odom_pose.inverse())
        self._stood[scan.frame] = odom_pose, scan
        return self.last_estimate

    def _follow_odometry(self, odom_pose: Pose2D, scan: LaserScan, laser_pose: Pose2D) -> None:
        moved = self.odometry.moved_frame(
            odom_pose, scan.stamp, self.map_from_odom,
            lambda pose: self.field.share_on_map(pose, self._pick(scan, laser_pose).hits))
        if moved is not None and self.map_from_odom is not None:
            self.map_from_odom = self.map_from_odom.compose(moved.inverse())
            self._odom_pose = None if self._odom_pose is None else moved.compose(self._odom_pose)

    def _has_moved(self, before: Pose2D, after: Pose2D, share: float = 1.0) -> bool:
        """Return whether the robot has moved as far as asks for an update, or a share of that."""
        values = self.parameters
        return (
            abs(after.x - before.x) > share * values.update_min_d
            or abs(after.y - before.y) > share * values.update_min_d
            or abs(angle_between(before.theta, after.theta)) > share * values.update_min_a
        )

    def _shown_way(self, odom_pose: Pose2D, scan: LaserScan) -> float:
        """Return the median change (m) of the beams since odometry stands or since the last update; robust form only.

        People walking by change few beams. 0 where too few beams returned both times.
        """
        stood_at, stood = self._stood[scan.frame]
        if self._has_moved(stood_at, odom_pose, STANDS) or not self.parameters.robust:
            self._stood[scan.frame] = odom_pose, scan
            return 0.0
        limits = limits_of(scan, self.parameters.laser_min_range, self.parameters.laser_max_range)
        before = stood.readings_at(scan.angles)
        seen = is_hit(before, limits)
        both = seen & is_hit(scan.ranges, limits)
        if np.count_nonzero(both) < max(FEWEST_BEAMS, 0.5 * np.count_nonzero(seen)):
            return 0.0
        return float(median(np.abs(scan.ranges[both] - before[both])))

    def _propagate(self, before: Pose2D, after: Pose2D, heading: float, shown: float) -> None:
        """Sample the motion (table 8.2, line 4) from a `heading` (rad) on the map; `shown` is the least way (m)."""
        if self.parameters.robust:
            fewest = min(self.parameters.max_particles, max(self.parameters.min_particles, FEWEST_PREDICTED))
            if len(self.poses) <= fewest // 2:
                self.poses, self.log_weights = replicate(self.poses, self.log_weights, fewest)
            tracker = self._tracker
            step = tracker.lever_arm.moved(after.relative_to(before))
            after = before.compose(step)
            added = tracker.lever_arm.predict(heading, step)
            noise = self._motion_model.covariance(before, after) if tracker.hypotheses.rivals else NO_NOISE
            tracker.predict(step, noise, shown)
            self.poses = spread(self.poses, added, self._rng)
        self.poses = self._motion_model.propagate(self.poses, before, after, self._rng)

    def _pick(self, scan: LaserScan, laser_pose: Pose2D) -> Beams:
        """Return the beams the filter looks at: all in the robust form."""
        return (self._all_beams if self.parameters.robust else self._laser_model.pick)(scan, laser_pose)

    def _all_beams(self, scan: LaserScan, laser_pose: Pose2D) -> Beams:
        return pick_beams(scan, laser_pose, 1, self.parameters.laser_min_range, self.parameters.laser_max_range)

    def _correct(self, scan: LaserScan, laser_pose: Pose2D, beams: Beams) -> Corrected:
        """Robust form: redraw and weight particles by the whole scan, or weight by the chosen laser model."""
        weigh = None
        if self.parameters.laser_model_type != OWN_MODEL:
            picked = self._laser_model.pick(scan, laser_pose)
            weigh = functools.partial(self._laser_model.tempered, beams=picked, converged=self._converged)
        corrected = self._tracker.correct(
            self.poses, self.log_weights, beams, scan.frame, self._rng, self._forced, weigh)
        self.poses, self.log_weights = corrected.poses, corrected.log_weights
        return corrected

    def _reweight(self, beams: Beams) -> float:
        """Weight particles by the likelihood and normalize (table 8.2, line 5); return the log of the average."""
        log_weights = self.log_weights + self._laser_model.log_likelihoods(self.poses, beams, self._converged)
        log_average = log_sum_exp(log_weights)
        self._averages.update(log_average, self.parameters.recovery_alpha_slow, self.parameters.recovery_alpha_fast)
        self.log_weights = log_weights - log_average
        return log_average

    def _estimate(self, weights: np.ndarray, pose: Optional[np.ndarray], moments: Optional[Moments]) -> Estimate:
        """Return the estimate of the held hypothesis, with a covariance over rivals, too.

        Args:
            weights: Of the particles, shape (N,), sum one.
            pose: Where the newest scan fits best, shape (3,); the mean of the heaviest cluster where None.
            moments: Of the particles, where they are known.
        """
        own = estimate(self.poses, weights, moments)
        if pose is not None:
            own = dataclasses.replace(own, pose=Pose2D(*map(float, pose)))
        rivals = self._tracker.hypotheses.rivals
        if not self.parameters.robust or not rivals:
            return own
        shares = np.exp([rival.log_weight for rival in rivals])
        everything = np.vstack((self.poses, [rival.belief.mean for rival in rivals]))
        weights = np.concatenate((weights * self._tracker.hypotheses.share_held, shares))
        _, covariance = mean_and_covariance(everything, weights)
        return Estimate(
            own.pose, covariance, own.weight * self._tracker.hypotheses.share_held, own.clusters + len(rivals))

    def _resample(self, weights: np.ndarray) -> None:
        """Resample by weights, shape (N,) (table 8.3, lines 11 to 17), unless selective_resampling defers it."""
        values = self.parameters
        if values.selective_resampling and 1.0 / np.square(weights).sum() > 0.5 * len(weights):
            return
        limits = particle_limits(
            values.max_particles, values.min_particles, values.kld_err, values.kld_z, values.robust)
        share = self._averages.random_share() if self.field.has_free_cells else 0.0
        self.poses = resample(self.poses, weights, limits, self._rng, share, self._random_poses)
        self.log_weights = np.full(len(self.poses), -math.log(len(self.poses)))
        self._converged = values.do_beamskip and is_converged(self.poses)  # nothing else asks
        if share > 0.0:
            self._averages.reset()

    def _random_poses(self, count: int) -> np.ndarray:
        return self.field.random_free_poses(count, self._rng)

    def _start(self, poses: np.ndarray) -> None:
        """Take new particles, shape (N, 3); the next scan updates them without a motion."""
        poses[:, 2] = normalize_angles(poses[:, 2])
        self.poses = poses
        self.log_weights = np.full(len(poses), -math.log(len(poses)))
        self._averages.reset()
        self._odom_pose = None
        self._forced = self._converged = False
        self._updates = 0.0
        self._tracker.start()

    def _make_models(self) -> None:
        self._laser_model = make_laser_model(self.field, self.parameters)
        self._motion_model = make_motion_model(self.parameters)
