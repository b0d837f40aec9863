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
    """Turns a path and what the robot sees into a velocity, once per cycle. It is never called by two threads at once.

    Attributes:
        watcher: Called with a CycleReport after each cycle, in the controller's thread, by controllers that give any;
            None for nobody.
        steering: Of a car whose driver takes a steering angle for a rate, as this controller's parameters say; None
            where they do not. Velocities are rates here all the same.
        odom_topic: The robot's odometry, where this controller's parameters name its topic; empty where they do not.
    """

    steering: Optional[Steering] = None
    odom_topic: str = ""

    def __init__(self, name: str, parameters: Any) -> None:
        super().__init__(name, parameters)
        self.watcher: Optional[Callable[[CycleReport], None]] = None
        self._speed_limits: Dict[str, Tuple[SpeedLimit, Optional[Pose2D]]] = {}

    def limit_speed(self, limit: SpeedLimit, source: str = "") -> None:
        """Drive no faster than `limit` until the robot has moved its distance; SpeedLimit() lifts it.

        Args:
            limit: Top speeds, and the distance for which they hold.
            source: Who sets it. Each source has one limit, and the lowest holds.
        """
        self._speed_limits[source] = (limit, None)

    def speed_limit_at(self, pose: Pose2D) -> SpeedLimit:
        """Return the limit in force with the robot at `pose`; one is lifted where the robot has moved far enough."""
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
        """Its own top speeds (m/s, rad/s), to which a speed zone's percentage refers; infinite where unknown."""
        return math.inf, math.inf

    @property
    def goal_tolerance(self) -> Optional[GoalTolerance]:
        """Tolerance of a goal whose action names none; None for a controller that has none."""
        return None

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
        """Return whether the robot stands at the end of the path.

        Args:
            state: As for `compute_velocity`.
            tolerance: From the action; the controller's own where None, and in the place of a part that is 0.
        """
