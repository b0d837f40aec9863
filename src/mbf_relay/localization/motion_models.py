"""Motion models: particles are moved by a step of odometry with noise (section 5.4)."""

from __future__ import annotations

import abc
import math
from typing import Dict, Optional, Tuple, Type

import numpy as np

from mbf_relay.geometry import Pose2D, angle_between, normalize_angle, normalize_angles
from mbf_relay.localization.motion_kernels import turn_drive_turn
from mbf_relay.localization.parameters import LocalizerParameters

SHORT_MOTION = 0.01
"""Translations (m) below this are a turn on the spot: their direction is noise."""
USUAL_STEP = 0.2
"""Motion (m, rad) between two updates by amcl's default `update_min_d`, for which users' alphas are tuned."""


class MotionModel(abc.ABC):
    """Moves particles by an odometry step with noise.

    amcl's plain models use the book's variance as a standard deviation; its "corrected" ones take the square root. Both
    are offered, because the plain ones are the default and users' alphas are tuned to them. In both, the noise of a
    drive depends on the number of updates: with shorter steps the total noise is smaller.

    In the robust form it does not: the variance is proportional to the motion, as that of a sum of independent errors.
    The rate is that of amcl's form with steps of USUAL_STEP, and at least `robust_odom_error`. Slips are not modelled
    here but by rival hypotheses.

    Attributes:
        alphas: 0 and amcl's alpha1 to alpha5; in the robust form the variance (m^2 or rad^2) for each per metre or
            radian of motion.
        corrected: Whether the square root is taken.
        least_rate: Smallest standard deviation (m) after one metre; None for amcl's form.
    """

    def __init__(self, parameters: LocalizerParameters, corrected: bool) -> None:
        self.corrected = corrected
        self.least_rate: Optional[float] = parameters.robust_odom_error if parameters.robust else None
        alphas = (
            parameters.odom_alpha1, parameters.odom_alpha2, parameters.odom_alpha3, parameters.odom_alpha4,
            parameters.odom_alpha5,
        )
        self.alphas = (0.0, *(alphas if self.least_rate is None else map(self._rate, alphas)))

    def deviation(self, *terms: Tuple[float, float], floor: float = 0.0) -> float:
        """Return the standard deviation for pairs of an alpha and a motion.

        Args:
            terms: Alphas with the motions (m or rad) they belong to.
            floor: Motion (m) from which the smallest deviation is computed in the robust form.
        """
        if self.least_rate is not None:
            return math.sqrt(max(sum(rate * motion for rate, motion in terms), self.least_rate**2 * floor))
        squares = sum(alpha * motion * motion for alpha, motion in terms)
        return math.sqrt(squares) if self.corrected else squares

    def _rate(self, alpha: float) -> float:
        """Return the variance that amcl's form gives to an alpha over one metre (or radian) of steps of USUAL_STEP."""
        deviation = math.sqrt(alpha) * USUAL_STEP if self.corrected else alpha * USUAL_STEP ** 2
        return deviation ** 2 / USUAL_STEP

    @abc.abstractmethod
    def covariance(self, before: Pose2D, after: Pose2D) -> np.ndarray:
        """Return the covariance, shape (3, 3), of an odometry step's noise, in the base's frame before the step."""

    @abc.abstractmethod
    def propagate(self, poses: np.ndarray, before: Pose2D, after: Pose2D, rng: np.random.Generator) -> np.ndarray:
        """Return particles, shape (N, 3), moved by a sample of the odometry step from `before` to `after`."""


class DifferentialModel(MotionModel):
    """Turn, drive, turn (sample_motion_model_odometry, table 5.6)."""

    def _decompose(self, before: Pose2D, after: Pose2D) -> Tuple[float, float, float, Tuple[float, float, float]]:
        """Return the first turn (rad), the translation (m), the second turn, and the deviations of the three."""
        translation = before.distance_to(after)
        bearing = math.atan2(after.y - before.y, after.x - before.x)
        first = 0.0 if translation < SHORT_MOTION else angle_between(before.theta, bearing)
        second = normalize_angle(angle_between(before.theta, after.theta) - first)
        # Driving backwards gives a first turn of pi though none is made, so noise counts turns from 0 or from pi.
        first_noise = min(abs(first), abs(angle_between(math.pi, first)))
        second_noise = min(abs(second), abs(angle_between(math.pi, second)))
        _, a1, a2, a3, a4, _ = self.alphas
        deviations = (
            self.deviation((a1, first_noise), (a2, translation), floor=first_noise + 0.25 * translation),
            self.deviation((a3, translation), (a4, first_noise), (a4, second_noise), floor=translation),
            self.deviation((a1, second_noise), (a2, translation), floor=second_noise + 0.25 * translation),
        )
        return first, translation, second, deviations

    def covariance(self, before: Pose2D, after: Pose2D) -> np.ndarray:
        first, translation, _, (turn, along, last_turn) = self._decompose(before, after)
        cos, sin, swing = math.cos(first), math.sin(first), turn * translation
        root = np.array([[along * cos, along * sin, 0.0], [-swing * sin, swing * cos, turn], [0.0, 0.0, last_turn]])
        spread: np.ndarray = root.T @ root
        return spread

    def propagate(self, poses: np.ndarray, before: Pose2D, after: Pose2D, rng: np.random.Generator) -> np.ndarray:
        first, translation, second, deviations = self._decompose(before, after)
        noise, moved = rng.standard_normal((3, len(poses))), np.empty((len(poses), 3))
        motion = np.array([first, translation, second])
        turn_drive_turn(np.ascontiguousarray(poses), noise, motion, np.array(deviations), moved)
        return moved


class OmnidirectionalModel(MotionModel):
    """Drive in any direction while turning; noise along, across and in heading (amcl's omni models)."""

    def covariance(self, before: Pose2D, after: Pose2D) -> np.ndarray:
        step = after.relative_to(before)
        along, heading, across = self._deviations(math.hypot(step.x, step.y), step.theta)
        bearing = math.atan2(step.y, step.x)
        turn = np.array(
            [[math.cos(bearing), -math.sin(bearing), 0.0], [math.sin(bearing), math.cos(bearing), 0.0], [0.0, 0.0, 1.0]]
        )
        covariance: np.ndarray = turn @ np.diag(np.square([along, across, heading])) @ turn.T
        return covariance

    def propagate(self, poses: np.ndarray, before: Pose2D, after: Pose2D, rng: np.random.Generator) -> np.ndarray:
        translation = before.distance_to(after)
        rotation = angle_between(before.theta, after.theta)
        bearing = (
            angle_between(before.theta, math.atan2(after.y - before.y, after.x - before.x)) if translation else 0.0
        )
        noise = rng.standard_normal((3, len(poses))) * np.array(self._deviations(translation, rotation))[:, None]
        direction = poses[:, 2] + bearing
        cos, sin = np.cos(direction), np.sin(direction)
        along, across = translation + noise[0], noise[2]
        moved = np.empty_like(poses)
        moved[:, 0] = poses[:, 0] + along * cos + across * sin
        moved[:, 1] = poses[:, 1] + along * sin - across * cos
        moved[:, 2] = normalize_angles(poses[:, 2] + rotation + noise[1])
        return moved

    def _deviations(self, driven: float, turned: float) -> Tuple[float, float, float]:
        """Return the standard deviations along (m), in heading (rad) and across (m)."""
        turned = abs(turned)
        _, a1, a2, a3, a4, a5 = self.alphas
        # The plain omni model of amcl swaps alpha 1 and 4; files tuned to it rely on that.
        a1, a4 = (a1, a4) if self.corrected else (a4, a1)
        return (
            self.deviation((a3, driven), (a4, turned), floor=driven),
            self.deviation((a1, turned), (a2, driven), floor=turned + 0.25 * driven),
            self.deviation((a4, turned), (a5, driven), floor=0.25 * driven),
        )


MODELS: Dict[str, Type[MotionModel]] = {"diff": DifferentialModel, "omni": OmnidirectionalModel}


def make_motion_model(parameters: LocalizerParameters) -> MotionModel:
    """Return the motion model the parameters name."""
    name, _, corrected = parameters.odom_model_type.partition("-")
    return MODELS[name](parameters, corrected == "corrected")

