"""Detection of odometry that was reset while the robot goes on, as by a restart of the base's driver."""

from __future__ import annotations

import math
from typing import Callable, Optional, Tuple

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import DOUBTFUL

JUMP = 0.5
"""Motion (m, or rad) between two scans, beyond what a robot can do in the time, up to which there is no jump."""
FASTEST = 10.0
"""Largest speed (m/s, or rad/s) of a robot."""
LIVELIEST = 10.0
"""Largest acceleration (m/s^2, or rad/s^2) of a robot, about that of gravity: friction allows wheels no more."""


class OdometryWatch:
    """Checks from scan to scan whether odometry was reset.

    A jump farther than a robot can move is taken for a reset if the scan fits the map at the former place, with the
    former heading or with odometry's, and better than where odometry leads: odometry may jump aside while the robot
    turns. Otherwise the robot itself was moved, as a simulator can do, odometry included.

    Attributes:
        jumps: Number of resets so far.
    """

    def __init__(self) -> None:
        self._last: Optional[Tuple[Pose2D, float]] = None
        self.jumps = 0
        self._pace = FASTEST  # of the last step, in metres or radians a second

    def moved_frame(
        self, odom_pose: Pose2D, now: float, map_from_odom: Optional[Pose2D],
        fit: Callable[[Pose2D], Optional[float]],
    ) -> Optional[Pose2D]:
        """Return the former odometry frame's pose in the new one after a reset; None where there was none.

        Args:
            odom_pose: Of the base in the odometry frame.
            now: Time (s) of `odom_pose`; after a jump back nothing is checked, since a simulation was set back.
            map_from_odom: Pose of the former odometry frame in the map's frame; None where it is not known.
            fit: Returns the share of the scan, 0 to 1, that the map explains from a pose; None where it cannot tell.
        """
        last, self._last = self._last, (odom_pose, now)
        if last is None or map_from_odom is None:
            return None
        (before, then), fastest, self._pace = last, self._pace, FASTEST
        if now <= then:
            return None
        step, elapsed = odom_pose.relative_to(before), now - then
        way = max(math.hypot(step.x, step.y), abs(step.theta))
        if way <= JUMP + elapsed * min(FASTEST, fastest + LIVELIEST * elapsed):
            self._pace = way / elapsed
            return None
        turned = before._replace(theta=odom_pose.theta)
        fits = [fit(map_from_odom.compose(pose)) for pose in (before, turned, odom_pose)]
        shares = [share for share in fits if share is not None]
        if len(shares) < len(fits) or max(shares[:2]) < DOUBTFUL or shares[2] >= max(shares[:2]):
            return None
        self.jumps += 1
        return odom_pose.compose((before if shares[0] >= shares[1] else turned).inverse())
