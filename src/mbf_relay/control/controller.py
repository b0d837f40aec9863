"""The abstract controller."""

from __future__ import annotations

import abc
import math
from typing import Any, Callable, Dict, Optional, Tuple

from mbf_relay.control.report import CycleReport
from mbf_relay.control.state import ControlState, GoalTolerance, SpeedLimit
from mbf_relay.control.steering import Steering
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.planning.path import Path
from mbf_relay.plugins import Plugin


class Controller(Plugin, abc.ABC):
    """Computes a velocity from the path and the local costmap, once per cycle. One thread at a time may call it.

    Attributes:
        watcher: Called with a CycleReport after each cycle, in the controller's thread, by controllers that make
            reports; None for no call.
        steering: Geometry of a car whose base driver expects a steering angle in angular.z, where the parameters say
            so; else None. Controllers compute rotational velocities all the same.
        odom_topic: Topic of odometry, where the parameters name one; else empty.
    """

    steering: Optional[Steering] = None
    odom_topic: str = ""

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.watcher: Optional[Callable[[CycleReport], None]] = None
        self._speed_limits: Dict[str, Tuple[SpeedLimit, Optional[Pose2D]]] = {}

    def limit_speed(self, limit: SpeedLimit, source: str = "") -> None:
        """Drive no faster than `limit` until the robot is farther away than its distance; SpeedLimit() lifts it.

        Args:
            limit: Top speeds, and the distance within which they hold.
            source: Name of the source. Each source has one limit; the lowest of all holds.
        """
        self._speed_limits[source] = (limit, None)

    def speed_limit_at(self, pose: Pose2D) -> SpeedLimit:
        """Return the limit in force at `pose` (costmap's frame); those left far enough behind are lifted."""
        lowest = SpeedLimit()
        for source, (limit, since) in list(self._speed_limits.items()):
            since = pose if since is None else since
            if pose.distance_to(since) > limit.distance:
                del self._speed_limits[source]
                continue
            self._speed_limits[source] = (limit, since)
            lowest = SpeedLimit(
                min(lowest.translation, limit.translation), min(lowest.rotation, limit.rotation),
                min(lowest.distance, limit.distance), min(lowest.share, limit.share),
            )
        return lowest

    @property
    def top_speeds(self) -> Tuple[float, float]:
        """The controller's top speeds (m/s, rad/s), to which percentages of speed zones refer; infinite if unknown."""
        return math.inf, math.inf

    @property
    def goal_tolerance(self) -> Optional[GoalTolerance]:
        """The tolerance used where the action's goal gives none; None for a controller that has none."""
        return None

    @abc.abstractmethod
    def set_path(self, path: Path, is_new_goal: bool) -> None:
        """Follow `path` from now on.

        Args:
            path: At least one pose, all finite.
            is_new_goal: False for a new plan to the same goal: a position once reached then still counts as reached.

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
        """Return whether the robot stands at the end of the path.

        Args:
            state: As for `compute_velocity`.
            tolerance: From the action; None, or 0 in a field, stands for the controller's own.
        """
