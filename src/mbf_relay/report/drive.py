"""The record of a drive: true and estimated trajectory, commands, goals, contacts; and its metrics."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Dict, List, Mapping, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, normalize_angles
from mbf_relay.maps import OccupancyMap

SUCCEEDED = "SUCCEEDED"
"""State of a goal that was reached."""


@dataclass
class GoalRecord:
    """One goal and how it ended.

    Attributes:
        pose: The goal, in the map frame.
        started: Time (s) it was accepted.
        ended: Time (s) it ended, None while it runs.
        state: Name of the terminal state, e.g. SUCCEEDED or ABORTED.
        text: The server's status text.
        recoveries: Names of the recovery behaviours that ran for it.
    """

    pose: Pose2D
    started: float
    ended: Optional[float] = None
    state: str = ""
    text: str = ""
    recoveries: List[str] = field(default_factory=list)

    @property
    def reached(self) -> bool:
        """Whether the goal ended in success."""
        return self.state == SUCCEEDED


@dataclass
class ContactRecord:
    """A contact of the robot: time (s), position (m, map frame) and the name of the other body."""

    stamp: float
    x: float
    y: float
    body: str


@dataclass
class Drive:
    """Everything a report shows. Trajectories are in the map frame; rows are time (s), x (m), y (m), heading (rad).

    Attributes:
        truth: The simulator's ground truth, shape (N, 4); empty where it is not known.
        estimate: Localization composed with odometry, shape (M, 4).
        commands: Time (s), forward speed (m/s) and turn rate (rad/s) of commands, shape (K, 3).
        measured: The same from odometry, shape (L, 3).
        plans: Time (s) and poses, shape (P, 3), of each new global plan.
        goals: Goals in the order in which they were accepted.
        contacts: All contacts.
        seen: Points seen by the lidar, shape (S, 2), map frame (m).
        map: The map, None without one.
        speed_limits: Top speed (m/s) and top turn rate (rad/s) of the robot, None where not known.
        wall_time: Duration (s) by the wall clock.
        seed: Seed of the simulation.
        goals_asked: Number of goals that were to be driven; where None, the number of `goals`.
        parameters: Parameters, nested by node.
        versions: Versions of the software, by name.
    """

    truth: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))
    estimate: np.ndarray = field(default_factory=lambda: np.empty((0, 4)))
    commands: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    measured: np.ndarray = field(default_factory=lambda: np.empty((0, 3)))
    plans: List[Tuple[float, np.ndarray]] = field(default_factory=list)
    goals: List[GoalRecord] = field(default_factory=list)
    contacts: List[ContactRecord] = field(default_factory=list)
    seen: np.ndarray = field(default_factory=lambda: np.empty((0, 2)))
    map: Optional[OccupancyMap] = None
    speed_limits: Optional[Tuple[float, float]] = None
    wall_time: Optional[float] = None
    seed: Optional[int] = None
    goals_asked: Optional[int] = None
    parameters: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def path(self) -> np.ndarray:
        """The truth where it is known, else the estimate."""
        return self.truth if len(self.truth) else self.estimate

    @property
    def span(self) -> Tuple[float, float]:
        """First and last time (s) of the drive: from the first goal to the end of the last, else of the path."""
        ends = [goal.ended for goal in self.goals if goal.ended is not None]
        if self.goals and ends:
            return self.goals[0].started, max(ends)
        stamps = self.path[:, 0]
        return (float(stamps[0]), float(stamps[-1])) if len(stamps) else (0.0, 0.0)

    def within_span(self, rows: np.ndarray) -> np.ndarray:
        """Return the rows whose time (first column) lies within the drive."""
        first, last = self.span
        return rows[(rows[:, 0] >= first) & (rows[:, 0] <= last)]

    def localization_errors(self) -> np.ndarray:
        """Return the error of the estimate against the truth at the estimate's times.

        Returns:
            Shape (E, 3): time (s), distance (m), heading error (rad, absolute); empty where there is no truth.
        """
        estimate = self.within_span(self.estimate)
        if len(self.truth) < 2 or not len(estimate):
            return np.empty((0, 3))
        known = (estimate[:, 0] >= self.truth[0, 0]) & (estimate[:, 0] <= self.truth[-1, 0])
        estimate = estimate[known]
        truth = interpolate(self.truth, estimate[:, 0])
        distance = np.hypot(estimate[:, 1] - truth[:, 1], estimate[:, 2] - truth[:, 2])
        return np.column_stack((estimate[:, 0], distance, np.abs(normalize_angles(estimate[:, 3] - truth[:, 3]))))

    def path_length(self) -> float:
        """Return the length (m) driven."""
        steps = np.diff(self.within_span(self.path)[:, 1:3], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())

    def summary(self) -> Dict[str, Any]:
        """Return the metrics of the drive, as written to report.json."""
        errors = self.localization_errors()
        first, last = self.span
        reached = sum(goal.reached for goal in self.goals)
        asked = self.goals_asked if self.goals_asked is not None else len(self.goals)
        return {
            "success": bool(asked) and reached == asked and not self.contacts,
            "goals_reached": reached,
            "goals_asked": asked,
            "contacts": len(self.contacts),
            "recoveries": sum(len(goal.recoveries) for goal in self.goals),
            "sim_time": round(last - first, 3),
            "wall_time": None if self.wall_time is None else round(self.wall_time, 3),
            "path_length": round(self.path_length(), 4),
            "localization_error_mean": _rounded(errors[:, 1].mean()) if len(errors) else None,
            "localization_error_max": _rounded(errors[:, 1].max()) if len(errors) else None,
            "heading_error_mean": _rounded(errors[:, 2].mean()) if len(errors) else None,
            "heading_error_max": _rounded(errors[:, 2].max()) if len(errors) else None,
            "seed": self.seed,
            "goals": [_goal_figures(goal) for goal in self.goals],
            "versions": dict(self.versions),
            "parameters": dict(self.parameters),
        }


def interpolate(rows: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    """Return a trajectory interpolated linearly at other times, headings the shorter way.

    Args:
        rows: Trajectory as in Drive, shape (N, 4), times rising.
        stamps: Times (s), shape (M,).

    Returns:
        Shape (M, 4).
    """
    headings = np.unwrap(rows[:, 3])
    columns = [np.interp(stamps, rows[:, 0], column) for column in (rows[:, 1], rows[:, 2], headings)]
    return np.column_stack([stamps] + columns)


def _rounded(value: float) -> float:
    return round(float(value), 5)


def _goal_figures(goal: GoalRecord) -> Dict[str, Any]:
    return {
        "pose": [round(float(value), 4) for value in goal.pose],
        "state": goal.state,
        "text": goal.text,
        "time": None if goal.ended is None else round(goal.ended - goal.started, 3),
        "recoveries": list(goal.recoveries),
    }
