"""What an episode notes while it is driven, and the figures made of it in the end."""

from __future__ import annotations

import hashlib
import struct
from typing import Any, Dict, List

import numpy as np

from mbf_relay.geometry import Pose2D, Twist2D, normalize_angles
from mbf_relay.lockstep import result as outcomes
from mbf_relay.lockstep.clearance import smallest_clearance
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.smoothness import path_length, smoothness
from mbf_relay.lockstep.tasks import Task

SAMPLING = 10.0
"""Hz at which the drive is noted."""


class Record:
    """Truth, belief and commands of one drive, in the world's frame."""

    def __init__(self, task: Task, seed: int, start_time: float) -> None:
        """Begin the record of a drive.

        Args:
            task: What is driven.
            seed: Seed of the episode.
            start_time: When (s) the simulation's movers began to move.
        """
        self._task, self._seed, self._start_time = task, seed, start_time
        self._times: List[float] = []
        self._truth: List[Pose2D] = []
        self._believed: List[Pose2D] = []
        self._hash = hashlib.sha256()

    def note(self, now: float, truth: Pose2D, believed: Pose2D) -> None:
        """Note where the robot is and where it believes to be, once per time."""
        if self._times and self._times[-1] == now:
            return
        self._times.append(now)
        self._truth.append(truth)
        self._believed.append(believed)
        self._hash.update(struct.pack("<7d", now, *truth, *believed))

    def note_command(self, now: float, velocity: Twist2D) -> None:
        """Note a velocity sent to the wheels."""
        self._hash.update(struct.pack("<4d", now, *velocity))

    def result(
        self, outcome: str, message: str, contacts: int, top_speed: float, reached: List[float], machine: Dict[str, Any]
    ) -> EpisodeResult:
        """Return what the drive came to.

        Args:
            outcome: See EpisodeResult.
            message: Why.
            contacts: How often the robot touched something.
            top_speed: Of the robot (m/s), for the score.
            reached: Times (s) at which goals were reached.
            machine: See EpisodeResult.
        """
        task, success = self._task, outcome == outcomes.SUCCEEDED
        times, truth = np.array(self._times), np.array(self._truth, dtype=float).reshape(-1, 3)
        believed = np.array(self._believed, dtype=float).reshape(-1, 3)
        driven = times - times[0]
        linear, angular = velocities(times, truth)
        length = path_length(truth)
        errors = np.hypot(*(believed - truth)[:, :2].T)
        reference = task.reference_path_length
        return EpisodeResult(
            world=task.name, seed=self._seed, success=success, outcome=outcome, message=message,
            goals_reached=len(reached), goals=len(task.goals), contacts=contacts, time=float(driven[-1]),
            time_limit=task.time_limit, path_length=length,
            smallest_clearance=smallest_clearance(task.world, times - self._start_time, truth),
            score=None if reference is None else outcomes.score(success, float(driven[-1]), reference, top_speed),
            localization_error_mean=float(errors.mean()), localization_error_max=float(errors.max()),
            heading_error_mean=float(np.abs(normalize_angles(believed[:, 2] - truth[:, 2])).mean()),
            final_error=float(np.hypot(*(truth[-1, :2] - np.array(task.goals[-1][:2])))),
            smoothness=smoothness(times, linear, angular, length),
            goal_times=tuple(time - self._times[0] for time in reached),
            trajectory=np.round(np.column_stack((driven, truth, linear, angular)), 4).tolist(),
            believed=np.round(believed, 4).tolist(), digest=self._hash.hexdigest(), machine=machine,
        )


def velocities(times: np.ndarray, poses: np.ndarray) -> "tuple[np.ndarray, np.ndarray]":
    """Return forward (m/s) and angular (rad/s) velocities between poses, each of shape (N,), the first ones zero.

    Args:
        times: Shape (N,), seconds, rising.
        poses: Shape (N, 3) as x, y, theta in metres and radians.
    """
    periods = np.diff(times)
    steps = np.diff(poses[:, :2], axis=0)
    middle = poses[:-1, 2] + 0.5 * normalize_angles(np.diff(poses[:, 2]))
    forward = (steps[:, 0] * np.cos(middle) + steps[:, 1] * np.sin(middle)) / periods
    angular = normalize_angles(np.diff(poses[:, 2])) / periods
    return np.concatenate(([0.0], forward)), np.concatenate(([0.0], angular))
