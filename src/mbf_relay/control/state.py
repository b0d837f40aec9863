"""What a controller is told in a cycle: the state of robot and surroundings, tolerances, and limits for a while."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Optional, Tuple

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D


@dataclass(frozen=True)
class ControlState:
    """What a controller knows in one cycle.

    Attributes:
        now: Time (s).
        pose: The robot in the costmap's frame, where it will be when it does what it is told now.
        velocity: The robot's velocity from odometry, body frame.
        costmap: The local costmap.
        costmap_from_path: Takes poses in the path's frame to the costmap's frame.
        period: Time (s) until the next cycle.
        commanded: The velocity sent to the robot last, where known: not the controller's own last one where that was
            held back, as at the end of a drive that was called off.
        delay: Seconds from a command to the motion it leads to, which lie between `now` and the time of `pose`; 0.0
            where that is little.
        pose_now: The robot in the costmap's frame at `now`; None where that is `pose`.
        told: What the wheels were told since the last cycle, on the mean, where known: less than the controller said
            where that came late, was slowed down or was held back.
    """

    now: float
    pose: Pose2D
    velocity: Twist2D
    costmap: CostGrid
    costmap_from_path: Pose2D = IDENTITY
    period: float = 0.1
    commanded: Optional[Twist2D] = None
    delay: float = 0.0
    pose_now: Optional[Pose2D] = None
    told: Optional[Twist2D] = None


@dataclass(frozen=True)
class GoalTolerance:
    """How near to the goal counts as reached.

    Attributes:
        distance: Metres.
        angle: Radians.
    """

    distance: float
    angle: float

    @staticmethod
    def of(given: Optional[GoalTolerance], distance: float, angle: float) -> GoalTolerance:
        """Return a goal's own tolerance where it has one, with these (m, rad) in the place of a part that is 0.

        No robot stands anywhere that exactly: in a message, 0 is a field that nobody filled in.
        """
        return GoalTolerance(*((given.distance or distance, given.angle or angle) if given else (distance, angle)))


@dataclass(frozen=True)
class SpeedLimit:
    """Lower top speeds for a while.

    Attributes:
        translation: Metres per second.
        rotation: Radians per second.
        share: Of the controller's own top speeds.
        distance: Metres from where it was set, beyond which it no longer holds.
    """

    translation: float = math.inf
    rotation: float = math.inf
    distance: float = math.inf
    share: float = 1.0

    def of(self, translation: float, rotation: float) -> Tuple[float, float]:
        """Return what is left of a controller's own top speeds (m/s, rad/s)."""
        return min(self.share * translation, self.translation), min(self.share * rotation, self.rotation)

    def slowed(self, velocity: Twist2D, translation: float, rotation: float) -> Twist2D:
        """Return a velocity along the same arc that keeps to this limit of a controller's own top speeds (m/s, rad/s).
        """
        factor = 1.0
        for value, top in zip((velocity.speed(), abs(velocity.theta)), self.of(translation, rotation)):
            if value > top:
                factor = min(factor, top / value)
        return velocity.scaled(factor)
