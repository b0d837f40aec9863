"""The simulated robot's interface for navigation, in place of tf and topics: transforms, odometry, commands."""

from __future__ import annotations

import math
from collections import deque
from typing import Callable, Deque, Optional, Set, Tuple

from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D, angle_between
from mbf_relay.navigation.odometry_monitor import OdometryMonitor
from mbf_relay.navigation.robot import Robot
from mbf_relay.outcomes import StaleDataError, TransformError

HISTORY = 2.0
"""Seconds for which odometry is kept, to look up the pose at a scan's time."""


class LockstepRobot(Robot):
    """Answers transforms from odometry and localization, and sends velocities to the wheels."""

    def __init__(self, send: Callable[[Twist2D], None], map_frame: str, odom_frame: str, base_frame: str) -> None:
        """Begin without odometry.

        Args:
            send: Called with each velocity for the wheels.
            map_frame, odom_frame, base_frame: Names of the frames.
        """
        super().__init__()
        self._send = send
        self._frames = map_frame, odom_frame, base_frame
        self._odometry: Deque[Tuple[float, Pose2D]] = deque()
        self._velocity: Optional[Twist2D] = None
        self._clock: Callable[[], float] = lambda: self.odometry_stamp
        self._monitor = OdometryMonitor()
        self._pose_timeout = self._odom_timeout = math.inf
        self.map_from_odom: Optional[Pose2D] = None
        """Pose of the odom frame in the map frame, as localization estimates it; None before it does."""

    def limit_ages(self, clock: Callable[[], float], pose_timeout: float, odom_timeout: float) -> None:
        """Refuse poses and velocities that are too old from now on, as the server does.

        Args:
            clock: Gives simulated time (s).
            pose_timeout: Largest age (s) of a pose.
            odom_timeout: Largest age (s) of a velocity.
        """
        self._clock, self._pose_timeout, self._odom_timeout = clock, pose_timeout, odom_timeout

    def add_odometry(self, stamp: float, base_in_odom: Pose2D, velocity: Twist2D) -> None:
        """Add a pose (odom frame) and velocity (body frame) of odometry at `stamp` (s)."""
        self._odometry.append((stamp, base_in_odom))
        while self._odometry[0][0] < stamp - HISTORY:
            self._odometry.popleft()
        self._velocity = velocity

    @property
    def fixed_frames(self) -> Set[str]:
        """Names of the frames in which the robot moves: map and odom."""
        return set(self._frames[:2])

    @property
    def odometry_stamp(self) -> float:
        """Time (s) of the newest odometry, minus infinity before the first."""
        return self._odometry[-1][0] if self._odometry else float("-inf")

    @property
    def base_in_odom(self) -> Pose2D:
        """The newest pose in odometry's frame.

        Raises:
            TransformError: There is no odometry yet, or it is too old.
        """
        if not self._odometry:
            raise TransformError("no odometry has arrived yet")
        age = self._clock() - self.odometry_stamp
        if age > self._pose_timeout:
            _, odom_frame, base_frame = self._frames
            raise TransformError(
                f"the transform from '{base_frame}' to '{odom_frame}' is {age:.2f} s old; at most "
                f"{self._pose_timeout:.2f} s allowed")
        return self._odometry[-1][1]

    @property
    def base_in_map(self) -> Pose2D:
        """The newest estimated pose in the map frame.

        Raises:
            TransformError: There is no odometry or no localization yet.
        """
        return self._correction().compose(self.base_in_odom)

    def odometry_at(self, stamp: float) -> Pose2D:
        """Return the pose in the odom frame at `stamp` (s), interpolated linearly.

        Raises:
            TransformError: `stamp` lies outside the poses kept.
        """
        later: Optional[Tuple[float, Pose2D]] = None
        for time, pose in reversed(self._odometry):
            if time <= stamp:
                return pose if later is None or time == stamp else _between((time, pose), later, stamp)
            later = (time, pose)
        raise TransformError(f"no odometry is kept for {stamp:.3f} s")

    def pose_in(self, frame: str) -> Pose2D:
        """Return the newest pose of the robot's base in `frame`."""
        return self.transform(frame, self._frames[2])

    def transform(self, target_frame: str, source_frame: str) -> Pose2D:
        """Return the newest transform that takes poses in `source_frame` to `target_frame`."""
        if target_frame == source_frame:
            return IDENTITY
        return self._in_odom(source_frame).relative_to(self._in_odom(target_frame))

    def velocity(self) -> Twist2D:
        """Return the newest velocity from odometry, body frame."""
        if self._velocity is None:
            raise StaleDataError("no odometry has arrived yet")
        age = self._clock() - self.odometry_stamp
        if age > self._odom_timeout:
            raise StaleDataError(f"odometry is {age:.2f} s old; at most {self._odom_timeout:.2f} s allowed")
        trouble = self._monitor.trouble(*self._odometry[-1], self._velocity)
        if trouble is not None:
            raise StaleDataError(trouble)
        return self._velocity

    def command(self, velocity: Twist2D) -> None:
        """Send a velocity (body frame) to the wheels."""
        self.commanded = velocity
        self.delay.tell(self._clock(), velocity)
        self._send(velocity)

    def _in_odom(self, frame: str) -> Pose2D:
        map_frame, odom_frame, base_frame = self._frames
        if frame == odom_frame:
            return IDENTITY
        if frame == map_frame:
            return self._correction().inverse()
        if frame == base_frame:
            return self.base_in_odom
        raise TransformError(f"there is no frame '{frame}'; there are {', '.join(self._frames)}")

    def _correction(self) -> Pose2D:
        if self.map_from_odom is None:
            raise TransformError(f"'{self._frames[0]}' and '{self._frames[1]}' are not related yet")
        return self.map_from_odom


def _between(before: Tuple[float, Pose2D], after: Tuple[float, Pose2D], stamp: float) -> Pose2D:
    (t0, a), (t1, b) = before, after
    share = (stamp - t0) / (t1 - t0)
    return Pose2D(
        a.x + share * (b.x - a.x), a.y + share * (b.y - a.y), a.theta + share * angle_between(a.theta, b.theta)
    )
