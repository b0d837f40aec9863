"""Plausibility checks of odometry: repeated poses while it moves, against tf, and its twist against its poses."""

from __future__ import annotations

from collections import deque
from typing import Deque, Optional, Tuple

import numpy as np

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D, angle_between
from mbf_relay.median import median

REPEATED_FOR = 0.5
"""Seconds for which a pose may stay exactly the same while the twist is nonzero; real motion changes its last bits."""
MOVES = 0.02
"""Speed (m/s or rad/s) above which the twist says that the robot moves."""
CAME = 0.03
"""Distance (m) or angle (rad) above which odometry's pose has changed."""
SETTLES = 0.1
"""Seconds by which odometry may lag behind tf; its pose is compared only after that time."""
APART = 0.1
"""Shortest time (s) between two poses to compute a velocity from: encoder steps make shorter ones too noisy."""
INTERRUPTED = 0.45
"""Time (s) between two readings above which no velocity is computed from them, as the robot may have driven and stopped
in between. The slowest controllers, at 3 Hz, read more often."""
WATCHED, ENOUGH, ANEW = 20, 8, 4
"""Number of velocities in the sliding window, number needed for a judgement, and number of new ones until the next."""
TELLS = np.array([0.05, 0.1])
"""Speeds (m/s, rad/s) above which velocities are compared."""
CONTRADICTS, AGREES = 0.5, 0.2
"""Error, relative to the greater speed, above which the twist is no longer used, and below which it is used again."""


class OdometryMonitor:
    """Detects odometry whose pose stands still although its twist is nonzero. A pose left at zeros is not judged."""

    def __init__(self) -> None:
        self._pose: Optional[Pose2D] = None
        self._since = 0.0

    def trouble(self, stamp: float, pose: Pose2D, velocity: Twist2D) -> Optional[str]:
        """Return why a reading must not be used, None where it may.

        Args:
            stamp: Its time (s).
            pose: Pose of the base in odometry's frame.
            velocity: Twist in the body frame (m/s, rad/s).
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
    """Detects a pose by tf that stands still while odometry moves.

    Where the broadcaster of odom -> base ends, another node may go on sending its last pose. A pose that was
    contradicted stays so until it changes, even if the robot stands meanwhile. Since tf and odometry arrive by
    different connections, odometry's reference pose is taken only SETTLES after tf's pose first came.
    """

    def __init__(self) -> None:
        self._pose: Optional[Pose2D] = None
        self._told: Optional[Pose2D] = None  # odometry's pose when tf's pose came
        self._since = 0.0

    def trouble(self, stamp: float, pose: Pose2D, told_at: float, told: Pose2D) -> Optional[str]:
        """Return why a pose must not be used, None where it may.

        Args:
            stamp: Time (s) of the transform.
            pose: Pose of the base by tf, in any frame, but always the same.
            told_at: Time (s) of odometry.
            told: Pose of the base by odometry.
        """
        if pose == IDENTITY or pose != self._pose or stamp < self._since:
            self._pose, self._told, self._since = pose, None, stamp
        if self._told is None:
            if told_at < self._since + SETTLES:
                return None
            self._told = told
        way, turn = told.distance_to(self._told), abs(angle_between(told.theta, self._told.theta))
        if not (way > CAME or turn > CAME):  # written so that NaN, from a driver without poses, contradicts nothing
            self._since = stamp
        if stamp - self._since <= REPEATED_FOR:
            return None
        return (f"the pose by tf repeats itself for {stamp - self._since:.2f} s although odometry has come {way:.2f} m "
                f"and {turn:.2f} rad")


class TwistMonitor:
    """Compares the twist of odometry with the velocity computed from its poses, and replaces a wrong twist by that.

    Some drivers leave the twist at zeros, or give it in odometry's frame, with the wrong sign or in degrees. With a
    twist of zeros, the robot would never gain speed and count as stuck.

    Attributes:
        doubt: Why the twist is not used, empty while it is.
    """

    def __init__(self) -> None:
        self.doubt = ""
        self._last: Optional[Tuple[float, Pose2D, Twist2D]] = None
        self._moved = STOP  # velocity by the last two poses
        self._seen: Deque[Tuple[Twist2D, Twist2D]] = deque(maxlen=WATCHED)  # velocity by poses, and by the twist
        self._unjudged = 0
        self._has_heading = False

    def believed(self, stamp: float, pose: Pose2D, told: Twist2D) -> Twist2D:
        """Return the velocity to use, in the body frame: the twist, or the velocity by poses while the twist is wrong.

        Args:
            stamp: Time (s) of the reading.
            pose: In odometry's frame; a pose that never changes, or always has heading 0, is not judged.
            told: The reading's twist (m/s, rad/s).
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
        # the mean is robust against jitter, the median against single jumps
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
    """Return the mean velocity (body frame) between two poses that are `duration` seconds apart."""
    turn = angle_between(begin.theta, end.theta)
    way = end.relative_to(begin._replace(theta=begin.theta + 0.5 * turn))
    return Twist2D(way.x / duration, way.y / duration, turn / duration)


def _sizes(velocities: np.ndarray) -> np.ndarray:
    """Return speed (m/s) and turn rate (rad/s), shape (..., 2), of velocities, shape (..., 3)."""
    return np.stack((np.hypot(velocities[..., 0], velocities[..., 1]), np.abs(velocities[..., 2])), axis=-1)
