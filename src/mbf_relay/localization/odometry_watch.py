"""Odometry that begins anew while the robot goes on, as that of a base does whose driver was restarted."""

from __future__ import annotations

import math
from typing import Callable, Optional, Tuple

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import DOUBTFUL

JUMP = 0.5
"""Metres, and radians, that odometry comes from one scan to the next beyond what any robot does meanwhile."""
FASTEST = 10.0
"""Metres, and radians, a second: what is slower is no jump, unless the robot cannot have got so fast since."""
LIVELIEST = 10.0
"""Metres, and radians, a second that a robot gets faster in a second: as much as it weighs would push no wheel."""


class OdometryWatch:
    """Tells from scan to scan whether odometry goes on.

    It may not where it comes farther than any robot does. It is not believed then if the scan fits where the robot was,
    and not as well where odometry leads: a robot may be put elsewhere in a simulation, and its odometry with it.

    Attributes:
        jumps: How often it did not go on.
    """

    def __init__(self) -> None:
        self._last: Optional[Tuple[Pose2D, float]] = None
        self.jumps = 0
        self._pace = FASTEST  # of the last step, in metres or radians a second

    def moved_frame(
        self, odom_pose: Pose2D, now: float, map_from_odom: Optional[Pose2D],
        fit: Callable[[Pose2D], Optional[float]],
    ) -> Optional[Pose2D]:
        """Return where the frame that odometry had before lies in the one it has begun; None where it goes on.

        Args:
            odom_pose: Where odometry has the base.
            now: The time of that (s); where time goes back, so may a robot in a simulation.
            map_from_odom: The former frame in the map, None where it is not known.
            fit: Tells which share of the scan, 0 to 1, the map explains from a pose; None where there is no telling.
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
        here, there = fit(map_from_odom.compose(before)), fit(map_from_odom.compose(odom_pose))
        if here is None or there is None or here < DOUBTFUL or there >= here:
            return None
        self.jumps += 1
        return odom_pose.compose(before.inverse())
