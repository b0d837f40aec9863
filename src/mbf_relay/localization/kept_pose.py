"""A pose that outlives the filter, with what odometry said then: a filter that starts again knows the way since."""

from __future__ import annotations

import math
from typing import Any, Callable, Dict, Mapping, NamedTuple, Optional, Tuple

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import DOUBTFUL

SAVED_ODOM = "saved_odom"
"""The parameter beside the initial pose that holds what odometry said when that pose was saved."""


class KeptPose(NamedTuple):
    """Where a robot was by the last filter, and by odometry, whose frame outlives a filter that dies.

    `pose` is the base's in the map's frame, `odom_pose` in odometry's, `stamp` the time of both (s).
    """

    pose: Pose2D
    odom_pose: Pose2D
    stamp: float

    def as_parameters(self) -> Dict[str, float]:
        """Return everything by its name below SAVED_ODOM."""
        numbers = (*self.odom_pose, self.stamp, *self.pose)
        return {name: float(value) for name, value in zip(_NAMES, numbers)}

    def resume(
        self, odom_pose: Pose2D, now: float, fit: Callable[[Pose2D], Optional[float]]
    ) -> Tuple[Pose2D, str]:
        """Return where the robot is on the map now, and a sentence about it.

        Odometry that began anew since, as that of a robot or a simulator that was restarted does, says nothing of the
        way: then time went back, or the scan fits the map where odometry leads less than half, and no better than where
        the robot was.

        Args:
            odom_pose: Where odometry has the base now.
            now: The time of that (s).
            fit: Tells which share of a scan, 0 to 1, the map explains from a pose; None where there is no telling.
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
    """Return what the last filter kept; None where it is nothing of the kind, or belongs to another initial pose.

    A launch file that sets the initial pose leaves the odometry of the last run on the parameter server.
    """
    if not isinstance(value, Mapping):
        return None
    numbers = [value.get(name) for name in _NAMES]
    if not all(type(number) in (int, float) and math.isfinite(number) for number in numbers):  # type: ignore[arg-type]
        return None
    kept = KeptPose(Pose2D(*numbers[4:]), Pose2D(*numbers[:3]), numbers[3])  # type: ignore[arg-type]
    return kept if kept.pose == initial_pose else None
