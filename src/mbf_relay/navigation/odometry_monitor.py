"""Whether odometry and its transform can be believed: what repeats itself while the robot moves says nothing of it."""

from __future__ import annotations

from collections import deque
from typing import Deque, Optional, Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D, angle_between
from mbf_relay.median import median

REPEATED_FOR = 0.5
"""Seconds for which odometry may repeat a pose to the last bit and tell of motion: what moves changes its last bits."""
MOVES = 0.02
"""Metres or radians per second from which the robot is said to move."""
CAME = 0.03
"""Metres or radians from which odometry has come somewhere else."""
SETTLES = 0.1
"""Seconds by which odometry may lag behind tf: after a standstill began, both tell of the motion before it."""
APART = 0.1
"""Seconds at least between two poses of which a velocity is made: what encoders count in steps is too rough before."""
INTERRUPTED = 0.45
"""Seconds between two readings from which they tell nothing of what was between them: a robot may drive and stop. The
slowest controllers, at 3 Hz, look more often."""
WATCHED, ENOUGH, ANEW = 20, 8, 4
"""Velocities made of poses that are looked at together, how many are needed, and after how many more they are again."""
TELLS = np.array([0.05, 0.1])
"""Metres and radians per second from which a velocity can contradict another."""
CONTRADICTS, AGREES = 0.5, 0.2
"""Shares of the greater velocity by which another is off that is not believed, or that is believed again."""


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


class TwistMonitor:
    """Holds the velocities that odometry tells against where its poses go.

    Drivers leave them at zeros, or tell them in odometry's frame, with another sign or in degrees, and other robots are
    driven by them: one of zeros never gains speed and is taken to be stuck.

    Attributes:
        doubt: Why they are not believed, empty while they are.
    """

    def __init__(self) -> None:
        self.doubt = ""
        self._last: Optional[Tuple[float, Pose2D, Twist2D]] = None
        self._moved = STOP  # from the reading before the last one to that
        self._seen: Deque[Tuple[Twist2D, Twist2D]] = deque(maxlen=WATCHED)  # how it moved, and what was told of it
        self._unjudged = 0
        self._has_heading = False

    def believed(self, stamp: float, pose: Pose2D, told: Twist2D) -> Twist2D:
        """Return the velocity to go by, body frame.

        Args:
            stamp: Time of a reading (s); those of one time are one.
            pose: In odometry's frame; one that never changes, or has no heading, says nothing.
            told: The velocity that came with it.
        """
        self._has_heading = self._has_heading or pose.theta != 0.0
        if not pose.is_finite():
            return told
        if self._last is None or not 0.0 <= stamp - self._last[0] <= INTERRUPTED:
            self._last, self._moved = (stamp, pose, told), told
            self._seen.clear()
            return told
        before, begin, told_before = self._last
        if stamp - before >= APART:
            self._moved = velocity_between(begin, pose, stamp - before)
            told_between = Twist2D(*(0.5 * (a + b) for a, b in zip(told_before, told)))
            self._last = stamp, pose, told
            if self._has_heading and pose != begin:
                self._seen.append((self._moved, told_between))
                self._unjudged += 1
                if len(self._seen) >= ENOUGH and self._unjudged >= ANEW:
                    self._unjudged = 0
                    self._judge()
        return self._moved if self.doubt else told

    def _judge(self) -> None:
        moved, told = np.array(self._seen).swapaxes(0, 1)
        off = moved - told
        # what jitters adds nothing to the mean, one jump nothing to the median
        errors = np.minimum(_sizes(np.mean(off, axis=0)), median(_sizes(off)))
        sizes = median(np.maximum(_sizes(moved), _sizes(told)))
        told_of = sizes > TELLS
        if not told_of.any():
            return
        limit = AGREES if self.doubt else CONTRADICTS
        if not (errors > limit * sizes)[told_of].any():
            self.doubt = ""
        elif not self.doubt:
            (vx, vy, turn), (px, py, pose_turn) = np.mean(told, axis=0), np.mean(moved, axis=0)
            self.doubt = (
                f"odometry tells a velocity of ({vx:.2f}, {vy:.2f}) m/s and {turn:.2f} rad/s where its poses go by "
                f"({px:.2f}, {py:.2f}) m/s and {pose_turn:.2f} rad/s")


def velocity_between(begin: Pose2D, end: Pose2D, duration: float) -> Twist2D:
    """Return the mean velocity, body frame, that leads from one pose to another within `duration` (s)."""
    turn = angle_between(begin.theta, end.theta)
    way = end.relative_to(begin._replace(theta=begin.theta + 0.5 * turn))
    return Twist2D(way.x / duration, way.y / duration, turn / duration)


def _sizes(velocities: np.ndarray) -> np.ndarray:
    """Return metres and radians per second of velocities, shape (..., 3): (..., 2)."""
    return np.stack((np.hypot(velocities[..., 0], velocities[..., 1]), np.abs(velocities[..., 2])), axis=-1)
