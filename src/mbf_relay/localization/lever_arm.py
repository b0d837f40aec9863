"""The lever arm: from the point that odometry follows to the one that scans have for the base, learnt on the drive.

A lidar that is mounted 0.2 m from where it is said to be comes 0.4 m along in a turn on the spot, in which odometry has
the robot standing; along a corridor no scan tells that it did, and odometry's noise, all of it independent, has no room
for it. The arm r is the same for the whole drive: a step m of odometry is one of r^-1 m r of the base. It is estimated
with the pose, in which each turn leaves some of the arm's error, so that what corrects the one corrects the other:
Schmidt's Kalman filter (1966) for the arm, beside the particles for the pose; Roy and Thrun 1999 for learning on the
drive what odometry errs by all along.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.gaussians import PoseGaussian

USUAL = 0.1
"""Deviation (m), of one axis, of an arm of which nothing is known yet."""
CHANGES = 0.01
"""Deviation (m) by which it changes in a radian of turns: wheels that skid turn about no fixed point."""
NEGLIGIBLE = 1e-3
"""Deviation (m) that is lost in what odometry errs in any step."""


class LeverArm:
    """Follows the arm.

    Attributes:
        arm: Estimate (m), shape (2,), in the base's frame.
        covariance: Of it, shape (2, 2).
    """

    def __init__(self) -> None:
        """Know nothing."""
        self.arm, self.covariance = np.zeros(2), np.eye(2) * USUAL ** 2
        self._cross = np.zeros((3, 2))  # covariance of the pose held, in the map's frame, with the arm

    def moved(self, step: Pose2D) -> Pose2D:
        """Return the base's step, in its own frame, for one of odometry."""
        swing = swing_of(0.0, step.theta) @ self.arm
        return Pose2D(step.x + float(swing[0]), step.y + float(swing[1]), step.theta)

    def predict(self, heading: float, step: Pose2D) -> np.ndarray:
        """Let a step leave some of the arm's error in the pose.

        Args:
            heading: Of the pose held before it (rad), in the map's frame.
            step: Of the base, in its own frame.

        Returns:
            What the step adds for that to the covariance of the position, shape (2, 2), in the map's frame.
        """
        cos, sin = math.cos(heading), math.sin(heading)
        cross, swing = self._cross, swing_of(heading, step.theta)
        cross[0] -= (sin * step.x + cos * step.y) * cross[2]
        cross[1] += (cos * step.x - sin * step.y) * cross[2]
        before = cross[:2] @ swing.T
        self.covariance += np.eye(2) * (CHANGES ** 2 * abs(step.theta))
        of_swing = swing @ self.covariance
        cross[:2] += of_swing
        added: np.ndarray = before + before.T + of_swing @ swing.T
        return added

    def correct(self, prior: PoseGaussian, posterior: PoseGaussian) -> None:
        """Take what a scan made of the pose held: the arm follows by as much as it explains of the pose's error."""
        gain = self._cross.T @ prior.information
        explained = gain @ self._cross
        # Particles, drawn anew, may hold less of the error than was left in them; of more the arm knows nothing.
        gain /= math.sqrt(max(1.0, largest_ratio(explained, self.covariance)))
        moved = posterior.mean - prior.mean
        moved[2] = math.remainder(moved[2], 2.0 * math.pi)
        self.arm = self.arm + gain @ moved
        self.covariance = self.covariance - gain @ (prior.covariance - posterior.covariance) @ gain.T
        self._cross = posterior.covariance @ gain.T

    def forget_pose(self) -> None:
        """Take another pose, in which there is nothing yet of the arm's error."""
        self._cross = np.zeros((3, 2))


def largest_ratio(part: np.ndarray, whole: np.ndarray) -> float:
    """Return the largest ratio, over all directions, of two variances that two covariances, shape (2, 2), have there.
    """
    (a, b), (_, c) = whole
    (d, e), (_, f) = part
    of_all = a * c - b * b
    half, product = 0.5 * (c * d - 2.0 * b * e + a * f) / of_all, (d * f - e * e) / of_all
    return float(half + math.sqrt(max(0.0, half * half - product)))


def swing_of(heading: float, turn: float) -> np.ndarray:
    """Return by how much the base moves in the map for each metre of an arm as it turns from a heading, shape (2, 2).
    """
    cos = math.cos(heading + turn) - math.cos(heading)
    sin = math.sin(heading + turn) - math.sin(heading)
    return np.array([[cos, -sin], [sin, cos]])


def spread(poses: np.ndarray, added: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return poses, shape (N, 3), their positions with noise of a covariance, shape (2, 2).

    Of this only what is above 0 counts: noise takes nothing away.
    """
    (a, b), (_, c) = added
    middle, half = 0.5 * (a + c), math.hypot(0.5 * (a - c), b)
    if middle + half < NEGLIGIBLE ** 2:
        return poses
    long, short = math.sqrt(middle + half), math.sqrt(max(0.0, middle - half))
    direction = 0.5 * math.atan2(2.0 * b, a - c)
    cos, sin, noise = math.cos(direction), math.sin(direction), rng.standard_normal((2, len(poses)))
    moved = poses.copy()
    moved[:, 0] += (long * cos) * noise[0] - (short * sin) * noise[1]
    moved[:, 1] += (long * sin) * noise[0] + (short * cos) * noise[1]
    return moved
