"""Whether odometry and its transform can be believed: what repeats itself while the robot moves says nothing of it."""

from __future__ import annotations

from typing import Optional

from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D, angle_between

REPEATED_FOR = 0.5
"""Seconds for which odometry may repeat a pose to the last bit and tell of motion: what moves changes its last bits."""
MOVES = 0.02
"""Metres or radians per second from which the robot is said to move."""
CAME = 0.03
"""Metres or radians from which odometry has come somewhere else."""
SETTLES = 0.1
"""Seconds by which odometry may lag behind tf: after a standstill began, both tell of the motion before it."""


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


class TransformMonitor:
    """Holds the poses of tf against odometry's, which say the same in frames of their own.

    Where the node that broadcasts odometry's transform ends, another one's old pose may go on. What was contradicted
    stays so until the pose changes: a robot that stands meanwhile has not got nearer to where tf has it. The two come
    by different ways: where odometry was while tf first had a pose is read off only once both are of the same time.
    """

    def __init__(self) -> None:
        self._pose: Optional[Pose2D] = None
        self._told: Optional[Pose2D] = None  # by odometry, where it had got to with this pose
        self._since = 0.0

    def trouble(self, stamp: float, pose: Pose2D, told_at: float, told: Pose2D) -> Optional[str]:
        """Return why a pose must not be driven on, or None.

        Args:
            stamp: Its time (s).
            pose: Of the base by tf, in any frame.
            told_at: The time of odometry (s).
            told: Of the base by odometry.
        """
        if pose == IDENTITY or pose != self._pose or stamp < self._since:
            self._pose, self._told, self._since = pose, None, stamp
        if self._told is None:
            if told_at < self._since + SETTLES:
                return None
            self._told = told
        way, turn = told.distance_to(self._told), abs(angle_between(told.theta, self._told.theta))
        if not (way > CAME or turn > CAME):  # NaN, of a driver that tells no pose, contradicts none
            self._since = stamp
        if stamp - self._since <= REPEATED_FOR:
            return None
        return (f"the pose by tf repeats itself for {stamp - self._since:.2f} s although odometry has come {way:.2f} m "
                f"and {turn:.2f} rad")
