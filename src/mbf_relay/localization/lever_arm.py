"""Online calibration of the lever arm, from the point that odometry tracks to the base as scans see it.

A lidar mounted 0.2 m from where tf says moves by 0.4 m in a half turn on the spot, where odometry reports no motion. In
a corridor no scan shows that, and the motion model's noise, independent from step to step, does not cover it. The arm r
is constant: a step m of odometry is the step r^-1 m r of the base. Each turn adds the arm's error to the pose, so that
the two are correlated and a scan that corrects the pose corrects the arm, too. The arm and its cross-covariance with
the pose are kept as in a Schmidt-Kalman filter (1966), beside the particles for the pose. Compare Roy and Thrun 1999
for calibration of odometry on the drive.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.gaussians import PoseGaussian

USUAL = 0.1
"""Standard deviation (m), per axis, of the arm at first."""
CHANGES = 0.01
"""Process noise: standard deviation (m) per axis after a radian of turns; skidding wheels turn about no fixed point."""
NEGLIGIBLE = 1e-3
"""Standard deviation (m) below which noise is not added to particles: odometry's own is much larger."""


class LeverArm:
    """Estimate of the lever arm.

    Attributes:
        arm: Estimate (m), shape (2,), in the base's frame.
        covariance: Its covariance (m^2), shape (2, 2).
    """

    def __init__(self) -> None:
        """Begin with no arm and the deviation USUAL."""
        self.arm, self.covariance = np.zeros(2), np.eye(2) * USUAL ** 2
        self._cross = np.zeros((3, 2))  # covariance of the pose held, in the map's frame, with the arm

    def moved(self, step: Pose2D) -> Pose2D:
        """Return the base's step, in its own frame, for one of odometry."""
        swing = swing_of(0.0, step.theta) @ self.arm
        return Pose2D(step.x + float(swing[0]), step.y + float(swing[1]), step.theta)

    def predict(self, heading: float, step: Pose2D) -> np.ndarray:
        """Update the covariances for a step, in which a turn adds the arm's error to the pose.

        Args:
            heading: Of the base before the step (rad), in the map's frame.
            step: Of the base, in its own frame.

        Returns:
            Covariance (m^2) that the step adds to the position's, shape (2, 2), in the map's frame.
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
        """Correct the arm by what a scan changed in the correlated held pose, from `prior` to `posterior`."""
        gain = self._cross.T @ prior.information
        explained = gain @ self._cross
        # Resampled particles may vary less than the arm's error in them; the covariance would become negative.
        gain /= math.sqrt(max(1.0, largest_ratio(explained, self.covariance)))
        moved = posterior.mean - prior.mean
        moved[2] = math.remainder(moved[2], 2.0 * math.pi)
        self.arm = self.arm + gain @ moved
        self.covariance = self.covariance - gain @ (prior.covariance - posterior.covariance) @ gain.T
        self._cross = posterior.covariance @ gain.T

    def forget_pose(self) -> None:
        """Drop the correlation with the pose, as where another pose is held from now on."""
        self._cross = np.zeros((3, 2))


def largest_ratio(part: np.ndarray, whole: np.ndarray) -> float:
    """Return the largest ratio over all directions of `part`'s variance to `whole`'s; covariances of shape (2, 2).
    """
    (a, b), (_, c) = whole
    (d, e), (_, f) = part
    of_all = a * c - b * b
    half, product = 0.5 * (c * d - 2.0 * b * e + a * f) / of_all, (d * f - e * e) / of_all
    return float(half + math.sqrt(max(0.0, half * half - product)))


def swing_of(heading: float, turn: float) -> np.ndarray:
    """Return R(heading + turn) - R(heading), shape (2, 2): times the arm it is the base's motion (m) in the turn.
    """
    cos = math.cos(heading + turn) - math.cos(heading)
    sin = math.sin(heading + turn) - math.sin(heading)
    return np.array([[cos, -sin], [sin, cos]])


def spread(poses: np.ndarray, added: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return poses, shape (N, 3), with noise of a covariance (m^2), shape (2, 2), added to their positions.

    Negative eigenvalues, as of a turn that takes back the error of one before, count as 0.
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
