"""The abstract controller."""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass
from typing import Any, Optional

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D
from mbf_relay.planning.path import Path
from mbf_relay.plugins import Plugin


@dataclass(frozen=True)
class ControlState:
    """What a controller knows in one cycle.

    Attributes:
        now: Time (s).
        pose: The robot in the costmap's frame.
        velocity: The robot's velocity from odometry, body frame.
        costmap: The local costmap.
        costmap_from_path: Takes poses in the path's frame to the costmap's frame.
        period: Time (s) until the next cycle.
        commanded: The velocity sent to the robot last, where known: not the controller's own last one where that was
            held back, as at the end of a drive that was called off.
    """

    now: float
    pose: Pose2D
    velocity: Twist2D
    costmap: CostGrid
    costmap_from_path: Pose2D = IDENTITY
    period: float = 0.1
    commanded: Optional[Twist2D] = None


@dataclass(frozen=True)
class GoalTolerance:
    """How near is there.

    Attributes:
        distance: Metres.
        angle: Radians.
    """

    distance: float
    angle: float


@dataclass(frozen=True)
class SpeedLimit:
    """Lower top speeds for a while.

    Attributes:
        translation: Metres per second.
        rotation: Radians per second.
        distance: Metres from where it was set, beyond which it no longer holds.
    """

    translation: float = math.inf
    rotation: float = math.inf
    distance: float = math.inf


class Controller(Plugin, abc.ABC):
    """Turns a path and what the robot sees into a velocity, once per cycle. It is never called by two threads at once."""

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self._speed_limit = SpeedLimit()
        self._limited_from: Optional[Pose2D] = None

    def limit_speed(self, limit: SpeedLimit) -> None:
        """Drive no faster than `limit` until the robot has moved its distance; SpeedLimit() lifts it."""
        self._speed_limit, self._limited_from = limit, None

    def speed_limit_at(self, pose: Pose2D) -> SpeedLimit:
        """Return the limit in force with the robot at `pose`; it is lifted where the robot has moved far enough."""
        if self._limited_from is None:
            self._limited_from = pose
        if pose.distance_to(self._limited_from) > self._speed_limit.distance:
            self._speed_limit = SpeedLimit()
        return self._speed_limit

    @abc.abstractmethod
    def set_path(self, path: Path, is_new_goal: bool) -> None:
        """Follow `path` from now on.

        Args:
            path: At least one pose, all finite.
            is_new_goal: False where only the way to the same goal changed; what was reached stays reached then.

        Raises:
            ControlError: INVALID_PATH.
        """

    @abc.abstractmethod
    def compute_velocity(self, state: ControlState) -> Twist2D:
        """Return the velocity to command until the next cycle, within limits and accelerations.

        Raises:
            ControlError: NO_VALID_CMD, COLLISION, ROBOT_STUCK, MISSED_PATH, BLOCKED_PATH, BLOCKED_GOAL or MISSED_GOAL,
                with a text that says why. The robot is stopped then.
        """

    @abc.abstractmethod
    def is_goal_reached(self, state: ControlState, tolerance: Optional[GoalTolerance] = None) -> bool:
        """Tell whether the robot stands at the end of the path.

        Args:
            state: As for `compute_velocity`.
            tolerance: From the action; the controller's own where None.
        """
