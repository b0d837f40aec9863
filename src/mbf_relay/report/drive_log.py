"""Collects a drive from events, which come from topics or from a bag."""

from __future__ import annotations

import bisect
from typing import Dict, List, Optional, Sequence, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.maps import OccupancyMap
from mbf_relay.report.drive import ContactRecord, Drive, GoalRecord
from mbf_relay.touching import Touched


class DriveLog:
    """Takes events in the order of their times and returns them as a Drive. All times are in seconds.

    Not thread-safe.
    """

    def __init__(self) -> None:
        self.map: Optional[OccupancyMap] = None
        self._truth: List[Tuple[float, ...]] = []
        self._odometry: List[Tuple[float, ...]] = []
        self._corrections: List[Tuple[float, Pose2D]] = []
        self._commands: List[Tuple[float, float, float]] = []
        self._measured: List[Tuple[float, float, float]] = []
        self._plans: List[Tuple[float, np.ndarray]] = []
        self._contacts: List[ContactRecord] = []
        self._touched = Touched()
        self._seen: List[np.ndarray] = []
        self._goals: Dict[str, GoalRecord] = {}

    def begun_anew(self, now: float) -> DriveLog:
        """Return a new log from `now` (s) on, after the clock was set back; with the map, and the goals that run."""
        log = DriveLog()
        log.map = self.map
        for identity, goal in self._goals.items():
            if goal.ended is None:
                log.start_goal(now, identity, goal.pose)
        return log

    def add_truth(self, stamp: float, pose: Pose2D) -> None:
        """Add the robot's true pose in the map frame."""
        self._append(self._truth, (stamp, *pose))

    def add_odometry(self, stamp: float, pose: Pose2D) -> None:
        """Add the robot's pose in the odom frame."""
        self._append(self._odometry, (stamp, *pose))

    def add_velocity(self, stamp: float, velocity: Twist2D) -> None:
        """Add the robot's velocity by odometry, body frame."""
        self._append(self._measured, (stamp, velocity.x, velocity.theta))

    def add_seen(self, points: np.ndarray) -> None:
        """Add points seen by the lidar, shape (S, 2), map frame (m); they are drawn where there is no map."""
        self._seen.append(np.asarray(points, dtype=float))

    def add_correction(self, stamp: float, map_from_odom: Pose2D) -> None:
        """Add a pose of the odom frame in the map frame, by localization; it holds from its stamp on."""
        if not self._corrections or self._corrections[-1][1] != map_from_odom:
            self._append(self._corrections, (stamp, map_from_odom))

    def add_command(self, stamp: float, velocity: Twist2D) -> None:
        """Add a commanded velocity."""
        self._append(self._commands, (stamp, velocity.x, velocity.theta))

    def add_plan(self, stamp: float, poses: np.ndarray) -> None:
        """Add a global plan, shape (P, 3), in the map frame."""
        self._append(self._plans, (stamp, np.asarray(poses, dtype=float)))

    def add_contact(self, stamp: float, x: float, y: float, body: str) -> None:
        """Add a contact, unless it continues the last one with the same body."""
        if self._touched.note_contact(body, stamp):
            self._contacts.append(ContactRecord(stamp, x, y, body))

    def start_goal(self, stamp: float, identity: str, pose: Pose2D) -> None:
        """Add a goal, in the map frame, that was accepted; ignored where its id is known."""
        if identity not in self._goals:
            self._goals[identity] = GoalRecord(pose, stamp)

    def end_goal(self, stamp: float, identity: str, state: str, text: str) -> None:
        """Set how a goal ended; ignored where it has ended already."""
        goal = self._goals.get(identity)
        if goal is not None and goal.ended is None:
            goal.ended, goal.state, goal.text = stamp, state, text

    def add_recovery(self, name: str) -> None:
        """Add a recovery behaviour to the goal that runs."""
        running = [goal for goal in self._goals.values() if goal.ended is None]
        if running:
            running[-1].recoveries.append(name)

    @property
    def goals(self) -> List[GoalRecord]:
        """The goals so far, in the order in which they were accepted."""
        return list(self._goals.values())

    def drive(self) -> Drive:
        """Return the drive so far, without what only the caller knows (wall time, seed, versions)."""
        return Drive(
            truth=_rows(self._truth, 4),
            estimate=self._estimate(),
            commands=_rows(self._commands, 3),
            measured=_rows(self._measured, 3),
            plans=list(self._plans),
            goals=self.goals,
            contacts=list(self._contacts),
            seen=np.concatenate(self._seen) if self._seen else np.empty((0, 2)),
            map=self.map,
        )

    def _estimate(self) -> np.ndarray:
        stamps = [stamp for stamp, _ in self._corrections]
        rows = []
        for stamp, x, y, theta in self._odometry:
            index = bisect.bisect_right(stamps, stamp) - 1
            if index >= 0:
                rows.append((stamp, *self._corrections[index][1].compose(Pose2D(x, y, theta))))
        return _rows(rows, 4)

    @staticmethod
    def _append(rows: List, row: Tuple) -> None:
        if not np.isfinite([value for value in row if isinstance(value, float)]).all():
            return  # NaN and infinity are left out
        # Where stamps go back, as after a simulator's reset, later rows are dropped.
        while rows and rows[-1][0] > row[0]:
            rows.pop()
        rows.append(row)


def _rows(rows: Sequence[Tuple[float, ...]], columns: int) -> np.ndarray:
    return np.array(rows, dtype=float).reshape(-1, columns)
