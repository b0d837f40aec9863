"""Whether odometry can be believed: one that repeats its pose and tells a velocity says nothing of the robot."""

from __future__ import annotations

from typing import Optional

from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D

REPEATED_FOR = 0.5
"""Seconds for which odometry may repeat a pose to the last bit and tell of motion: what moves changes its last bits."""
MOVES = 0.02
"""Metres or radians per second from which the robot is said to move."""


class OdometryMonitor:
    """Judges odometry by itself, one reading after the other. A pose that is never filled in says nothing."""

    def __init__(self) -> None:
        self._pose: Optional[Pose2D] = None
        self._since = 0.0

    def trouble(self, stamp: float, pose: Pose2D, velocity: Twist2D) -> Optional[str]:
        """Return why a reading must not be driven on, or None.

        Args:
            stamp: Its time (s).
            pose: Of the base in odometry's frame.
            velocity: Body frame.
        """
        moves = max(velocity.speed(), abs(velocity.theta)) > MOVES
        if not moves or pose == IDENTITY or pose != self._pose or stamp < self._since:
            self._pose, self._since = pose, stamp
            return None
        if stamp - self._since <= REPEATED_FOR:
            return None
        return (f"odometry repeats the same pose for {stamp - self._since:.2f} s although it tells a velocity of "
                f"{velocity.speed():.2f} m/s and {velocity.theta:.2f} rad/s")
