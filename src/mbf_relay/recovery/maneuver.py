"""Shared by behaviours that move: the robot's pose on the local costmap, and the collision check of its next poses."""

from __future__ import annotations

from typing import Any, Callable, NamedTuple

import numpy as np

from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import RecoveryError, RecoveryOutcome, StaleDataError, TransformError
from mbf_relay.recovery.recovery import RecoveryContext


class CheckedPose(NamedTuple):
    """The robot's pose in the local costmap's frame, and a footprint checker on a snapshot of that costmap."""

    pose: Pose2D
    checker: FootprintChecker

    def free_steps(self, poses: np.ndarray) -> int:
        """Return how many of consecutive poses, shape (S, 3), are free, from the first on.

        Obstacles that the footprint touches already do not count as long as it does not go farther into them.
        """
        return self.checker.free_steps(poses, self.pose)


def checked_pose(context: RecoveryContext, name: str) -> CheckedPose:
    """Return the robot's pose on the current local costmap.

    Raises:
        RecoveryError: TF_ERROR where the pose is not known, FAILURE where there is no local costmap or it is too old.
    """
    costmap: Any = context.costmaps.get("local")
    if costmap is None:
        raise RecoveryError(RecoveryOutcome.FAILURE, f"'{name}' needs a local costmap, and there is none")
    stale = costmap.stale_reason(context.now)
    if stale:
        raise RecoveryError(RecoveryOutcome.FAILURE, f"'{name}' does not move blindly: {stale}")
    try:
        return CheckedPose(context.pose_in(costmap.frame), FootprintChecker(costmap.snapshot()))
    except TransformError as error:
        raise RecoveryError(RecoveryOutcome.TF_ERROR, f"'{name}' does not know where the robot is: {error}") from error


def measured(read: Callable[[], Any], name: str) -> Any:
    """Return what `read` gives; raise RecoveryError FAILURE where the data is too old to move on."""
    try:
        return read()
    except StaleDataError as error:
        raise RecoveryError(RecoveryOutcome.FAILURE, f"'{name}' does not move blindly: {error}") from error
