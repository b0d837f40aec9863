"""The last pose, saved with its odometry pose, so that a restarted filter can add the motion since."""

from __future__ import annotations

import math
from typing import Any, Callable, Dict, Mapping, NamedTuple, Optional, Tuple

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import DOUBTFUL

SAVED_ODOM = "saved_odom"
"""Name of the parameter, beside the initial pose, with the odometry pose at the time when that was saved."""


class KeptPose(NamedTuple):
    """The base's pose by the last filter and by odometry, at one time.

    Attributes:
        pose: In the map's frame.
        odom_pose: In the odometry frame.
        stamp: Time (s) of both.
    """

    pose: Pose2D
    odom_pose: Pose2D
    stamp: float

    def as_parameters(self) -> Dict[str, float]:
        """Return all values by their names below SAVED_ODOM."""
        numbers = (*self.odom_pose, self.stamp, *self.pose)
        return {name: float(value) for name, value in zip(_NAMES, numbers)}

    def resume(
        self, odom_pose: Pose2D, now: float, fit: Callable[[Pose2D], Optional[float]]
    ) -> Tuple[Pose2D, str]:
        """Return the base's pose in the map's frame now, and a phrase for the log that says where it comes from.

        It is the saved pose moved by odometry, or the saved pose itself where odometry was reset since, as on a restart
        of the robot or the simulator: where time went back, or where less than DOUBTFUL of the scan fits the map at the
        moved pose, and no more than at the saved one.

        Args:
            odom_pose: Of the base in the odometry frame, now.
            now: Time (s) of `odom_pose`.
            fit: Returns the share of a scan, 0 to 1, that the map explains from a pose; None where it cannot tell.
        """
        if now < self.stamp:
            return self.pose, f"where it was saved: time went back by {self.stamp - now:.1f} s, so odometry began anew"
        motion = odom_pose.relative_to(self.odom_pose)
        moved = self.pose.compose(motion)
        there, here = fit(moved), fit(self.pose)
        if there is not None and here is not None and there < DOUBTFUL and there <= here:
            return self.pose, (
                f"where it was saved: {100.0 * here:.0f} % of the scan lies on the map's walls there, "
                f"{100.0 * there:.0f} % where odometry leads, which began anew")
        way = math.hypot(motion.x, motion.y)
        return moved, f"where it was saved {now - self.stamp:.1f} s ago and the {way:.2f} m odometry has seen since"


_NAMES = ("x", "y", "a", "stamp", "pose_x", "pose_y", "pose_a")


def kept_pose_from(value: Any, initial_pose: Pose2D) -> Optional[KeptPose]:
    """Return the pose the last filter saved; None where `value` is no such thing or is of another initial pose.

    The latter happens where a launch file sets the initial pose: the saved odometry of the last run stays on the
    parameter server.
    """
    if not isinstance(value, Mapping):
        return None
    numbers = [value.get(name) for name in _NAMES]
    if not all(type(number) in (int, float) and math.isfinite(number) for number in numbers):  # type: ignore[arg-type]
        return None
    kept = KeptPose(Pose2D(*numbers[4:]), Pose2D(*numbers[:3]), numbers[3])  # type: ignore[arg-type]
    return kept if kept.pose == initial_pose else None
