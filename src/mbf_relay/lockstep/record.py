"""The record of an episode while it is driven, and the metrics computed from it at the end."""

from __future__ import annotations

import hashlib
import struct
from typing import Any, Dict, List, Optional, Sequence, Tuple

import numpy as np

from mbf_relay.control.state import GoalTolerance
from mbf_relay.geometry import Pose2D, Twist2D, normalize_angles
from mbf_relay.lockstep import result as outcomes
from mbf_relay.lockstep.clearance import clearances, smallest, smallest_time_to_collision
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.smoothness import path_length, smoothness
from mbf_relay.lockstep.tasks import EpisodeTask
from mbf_relay.lockstep.touches import Touches
from mbf_relay.simulation.contacts import Contact
from mbf_relay.simulation.robot import OMNIDIRECTIONAL, RobotModel

SAMPLING = 10.0
"""Rate (Hz) at which poses are recorded."""


class Record:
    """True poses, estimated poses and commands of one drive, in the world's frame.

    Attributes:
        recoveries: Number of recovery behaviours started.
        touches: Contacts of the robot.
    """

    def __init__(self, task: EpisodeTask, seed: int, start_time: float, robot: RobotModel) -> None:
        """Begin the record of a drive.

        Args:
            task: The task.
            seed: Seed of the episode.
            start_time: Simulated time (s) at which the movers began to move.
            robot: The robot.
        """
        self._task, self._seed, self._start_time, self._robot = task, seed, start_time, robot
        self._times: List[float] = []
        self._truth: List[Pose2D] = []
        self._believed: List[Pose2D] = []
        self._hash = hashlib.sha256()
        self.recoveries = 0
        self.touches = Touches()

    def note(self, now: float, truth: Pose2D, believed: Pose2D) -> None:
        """Record the robot's true and estimated pose at a time (s); a second call at the same time is ignored."""
        if self._times and self._times[-1] == now:
            return
        self._times.append(now)
        self._truth.append(truth)
        self._believed.append(believed)
        self._hash.update(struct.pack("<7d", now, *truth, *believed))

    def note_contacts(self, now: float, contacts: Sequence[Contact], truth: Pose2D, commanded: Twist2D) -> None:
        """Record what the robot touches at a time (s), its true pose in the world's frame, and its last command."""
        latest = -2 if self._times[-1] == now and len(self._times) > 1 else -1
        self.touches.note(now, contacts, (self._times[latest], self._truth[latest]), truth, commanded)

    def note_command(self, now: float, velocity: Twist2D) -> None:
        """Record a commanded velocity at a time (s)."""
        self._hash.update(struct.pack("<4d", now, *velocity))

    def result(
        self, outcome: str, message: str, top_speed: float, reached: List[float],
        tolerance: Optional[GoalTolerance], machine: Dict[str, Any],
    ) -> EpisodeResult:
        """Return the result with all metrics.

        Args:
            outcome, message, machine: See EpisodeResult.
            top_speed: The robot's top speed (m/s), for the score.
            reached: Times (s) at which goals were reached.
            tolerance: The controller's; None where the task's radius decides, or the controller declares none.
        """
        task, success = self._task, outcome == outcomes.SUCCEEDED
        times, truth = np.array(self._times), np.array(self._truth, dtype=float).reshape(-1, 3)
        believed = np.array(self._believed, dtype=float).reshape(-1, 3)
        driven = times - times[0]
        linear, angular = velocities(times, truth)
        length = path_length(truth)
        along = speeds(times, truth) if self._robot.drive == OMNIDIRECTIONAL else linear
        errors = np.hypot(*(believed - truth)[:, :2].T)
        reference = task.reference_path_length
        near = clearances(task.world, times - self._start_time, truth, self._robot)
        periods = np.diff(times)
        around = near.to_any[np.isfinite(near.to_any)]
        to_movers = near.to_movers.min(axis=0, initial=np.inf)
        return EpisodeResult(
            world=task.name, seed=self._seed, success=success, outcome=outcome, message=message,
            goals_reached=len(reached), goals=len(task.goals), contacts=len(self.touches.times),
            contacts_at_fault=self.touches.at_fault,
            contact_times=tuple(time - times[0] for time in self.touches.times), time=float(driven[-1]),
            time_limit=task.time_limit, path_length=length,
            smallest_clearance=smallest(near.to_any),
            mean_clearance=float(around.mean()) if len(around) else None,
            close_time=float(periods @ (near.to_any[1:] < outcomes.CLOSE)),
            closest_approach=smallest(to_movers),
            time_to_collision=smallest_time_to_collision(times, near.to_movers, near.jumps),
            personal_space_time=float(periods @ (to_movers[1:] < outcomes.PERSONAL_SPACE)),
            recoveries=self.recoveries, reference_path_length=reference,
            score=None if reference is None else outcomes.score(success, float(driven[-1]), reference, top_speed),
            localization_error_mean=float(errors.mean()), localization_error_max=float(errors.max()),
            heading_error_mean=float(np.abs(normalize_angles(believed[:, 2] - truth[:, 2])).mean()),
            final_error=float(np.hypot(*(truth[-1, :2] - np.array(task.goals[-1][:2])))),
            smoothness=smoothness(times, along, angular, length),
            goal_times=tuple(time - self._times[0] for time in reached),
            goal_waits=() if tolerance is None else waits(times, believed, task.goals, reached, tolerance),
            trajectory=np.round(np.column_stack((driven, truth, linear, angular)), 4),
            believed=np.round(believed, 4), digest=self._hash.hexdigest(), machine=machine,
        )


def velocities(times: np.ndarray, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return forward (m/s) and angular (rad/s) velocities from each pose before, each of shape (N,), the first zero.

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


def speeds(times: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Return speeds (m/s) from each pose before, in whatever direction; arguments and shape as for `velocities`."""
    steps = np.diff(poses[:, :2], axis=0)
    return np.concatenate(([0.0], np.hypot(steps[:, 0], steps[:, 1]) / np.diff(times)))


def waits(
    times: np.ndarray, poses: np.ndarray, goals: Sequence[Pose2D], reached: Sequence[float], tolerance: GoalTolerance
) -> Tuple[float, ...]:
    """Return how long (s) the estimated pose had been within tolerance of each goal, without a break, once reached.

    Args:
        times: Shape (N,), seconds, rising.
        poses: Estimated poses, shape (N, 3) as x, y, theta in metres and radians.
        goals: In the order they were reached; those never reached may follow.
        reached: Times (s) at which they were reached.
        tolerance: The controller's goal tolerance.
    """
    found = []
    for goal, end in zip(goals, reached):
        before = poses[times <= end]
        near = np.hypot(before[:, 0] - goal.x, before[:, 1] - goal.y) <= tolerance.distance
        near &= np.abs(normalize_angles(before[:, 2] - goal.theta)) <= tolerance.angle
        outside = np.flatnonzero(~near)
        first = int(outside[-1]) + 1 if len(outside) else 0
        found.append(float(end - times[first]) if first < len(before) else 0.0)
    return tuple(found)
