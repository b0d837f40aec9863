"""Inputs of a controller: state of robot and costmap in a cycle, goal tolerance, and temporary speed limits."""

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
        pose: The robot in the costmap's frame, predicted to the time `now + delay` at which a command sent now takes
            effect.
        velocity: The robot's velocity from odometry, body frame.
        costmap: The local costmap.
        costmap_from_path: Transform from the path's frame to the costmap's frame.
        period: Time (s) until the next cycle.
        commanded: The velocity published last, where known. It differs from the controller's last one where that was
            not published, as at the end of a cancelled drive.
        delay: Time (s) from a command to the motion it causes; 0.0 where that is negligible.
        pose_now: The robot in the costmap's frame at `now`; None where that is `pose`.
        told: Mean velocity sent to the wheels since the last cycle, where known; lower than the controller's where its
            command was late, slowed down or not published.
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
    """Distance and angle to the goal within which it counts as reached.

    Attributes:
        distance: Metres.
        angle: Radians.
    """

    distance: float
    angle: float

    @staticmethod
    def of(given: Optional[GoalTolerance], distance: float, angle: float) -> GoalTolerance:
        """Return a goal's own tolerance, with these defaults (m, rad) where it has none or a field is 0.

        A 0 in a message is a field that was not filled in.
        """
        return GoalTolerance(*((given.distance or distance, given.angle or angle) if given else (distance, angle)))


@dataclass(frozen=True)
class SpeedLimit:
    """Temporary limits of the speed.

    Attributes:
        translation: Top translational speed (m/s).
        rotation: Top rotational speed (rad/s).
        distance: Distance (m) from where it was set beyond which it is lifted.
        share: Further limit, as a share of the controller's own top speeds.
    """

    translation: float = math.inf
    rotation: float = math.inf
    distance: float = math.inf
    share: float = 1.0

    def of(self, translation: float, rotation: float) -> Tuple[float, float]:
        """Return a controller's own top speeds (m/s, rad/s) with this limit applied."""
        return min(self.share * translation, self.translation), min(self.share * rotation, self.rotation)

    def slowed(self, velocity: Twist2D, translation: float, rotation: float) -> Twist2D:
        """Return a velocity along the same arc that keeps to this limit of a controller's own top speeds (m/s, rad/s).
        """
        factor = 1.0
        for value, top in zip((velocity.speed(), abs(velocity.theta)), self.of(translation, rotation)):
            if value > top:
                factor = min(factor, top / value)
        return velocity.scaled(factor)
