"""Whether a goal's drive switches to a new path, and which places its plans avoid."""

from __future__ import annotations

from typing import Any, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.navigation.goals import FollowFeedback, FramedPose
from mbf_relay.navigation.path_hysteresis import PathHysteresis, leads_another_way, path_is_blocked
from mbf_relay.navigation.refused_places import Point, RefusedPlaces, Toll, refusing_place
from mbf_relay.navigation.robot import Robot
from mbf_relay.outcomes import StaleDataError, TransformError
from mbf_relay.planning.path import Path

STOOD_FOR = 2.0
"""Time (s) of refused control cycles, in all, that counts as one refusal of the place ahead."""


class _Ahead(NamedTuple):
    """The rest of a path on a snapshot of the global costmap.

    Attributes:
        costmap: The snapshot.
        rest: Poses from the one nearest to the robot on, shape (N, 3), in the costmap's frame.
        is_blocked: Whether an obstacle lies on the rest.
    """

    costmap: CostGrid
    rest: np.ndarray
    is_blocked: bool


class Ways:
    """Hysteresis between ways, and the places where the robot did not get through, for one move_base goal.

    Args:
        robot: Gives transforms.
        costmap: The global costmap.

    Attributes:
        refused: Number of refused control cycles, over all drives, since the last velocity or recovery.
    """

    def __init__(self, robot: Robot, costmap: Any) -> None:
        self._robot, self._costmap = robot, costmap
        self._hysteresis, self._refused = PathHysteresis(), RefusedPlaces()
        self._failures = 0
        self.refused = 0

    def restart(self) -> None:
        """Begin a new path: forget a pending switch, but not the refused places."""
        self._hysteresis.restart()

    def tolls(self, now: float) -> Tuple[Toll, ...]:
        """Return the places that plans should avoid at `now` (s), each with its toll."""
        return self._refused.tolls(now, self._costmap.snapshot().width)

    def takes(self, now: float, old: Path, new: Path, robot: Optional[FramedPose]) -> bool:
        """Return whether to switch, at `now` (s), from the path driven to a replanned one; all are in one frame."""
        if robot is None:
            return True
        width = self._costmap.snapshot().width
        if not leads_another_way(old.poses, new.poses, robot.pose, width):
            self._hysteresis.restart()
            return True
        ahead = self._ahead(old, robot)
        if not self._hysteresis.wants(now, robot.pose, width) and not (ahead is not None and ahead.is_blocked):
            return False
        self._failures = 0
        if ahead is not None:
            self._note(now, ahead, refusing_place(ahead.costmap, ahead.rest))
        return True

    def watch(self, now: float, feedback: FollowFeedback, path: Path, frequency: float) -> None:
        """Take the feedback at `now` (s) of a controller that is asked at `frequency` (Hz), along a path."""
        if not feedback.refused:
            self.refused = self.refused if feedback.is_unasked else 0
            return
        self._failures += 1
        self.refused += 1
        if self._failures >= STOOD_FOR * frequency:
            self._failures = 0
            self._refuse(now, path, feedback.pose)

    def is_blocked(self, path: Path, robot: Optional[FramedPose]) -> bool:
        """Return whether an obstacle lies on what is left of a path."""
        ahead = self._ahead(path, robot)
        return ahead is not None and ahead.is_blocked

    def _refuse(self, now: float, path: Path, robot: Optional[FramedPose]) -> None:
        """Count a refusal, at `now` (s), of the first place where the robot does not fit, else of the place just ahead.
        """
        ahead = self._ahead(path, robot)
        if ahead is not None and len(ahead.rest):
            arcs = np.hypot(*(ahead.rest[:, :2] - ahead.rest[0, :2]).T)
            before_it = ahead.rest[int((arcs >= ahead.costmap.circumscribed_radius).argmax()), :2]
            self._note(now, ahead, refusing_place(ahead.costmap, ahead.rest) or tuple(before_it.tolist()))

    def _note(self, now: float, ahead: _Ahead, place: Optional[Point]) -> None:
        if place is not None:
            self._refused.refuse(now, place, ahead.costmap.width)

    def _ahead(self, path: Path, robot: Optional[FramedPose]) -> Optional[_Ahead]:
        """Return the rest of a path on the costmap, None where a transform or the costmap is missing."""
        try:
            snapshot = self._costmap.snapshot()
            frame = self._costmap.frame
            frame_from_path = self._robot.transform(frame, path.frame)
            pose = None if robot is None else self._robot.transform(frame, robot.frame).compose(robot.pose)
        except (TransformError, StaleDataError):
            return None
        poses = frame_from_path.transform_poses(path.poses)
        nearest = 0 if pose is None else int(np.hypot(*(poses[:, :2] - pose[:2]).T).argmin())
        return _Ahead(snapshot, poses[nearest:], path_is_blocked(snapshot, poses, pose))
