"""The abstract controller."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import Optional

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
    """

    now: float
    pose: Pose2D
    velocity: Twist2D
    costmap: CostGrid
    costmap_from_path: Pose2D = IDENTITY
    period: float = 0.1


@dataclass(frozen=True)
class GoalTolerance:
    """How near is there.

    Attributes:
        distance: Metres.
        angle: Radians.
    """

    distance: float
    angle: float


class Controller(Plugin, abc.ABC):
    """Turns a path and what the robot sees into a velocity, once per cycle. It is never called by two threads at once."""

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
