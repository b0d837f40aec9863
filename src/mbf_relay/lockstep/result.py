"""The result of an episode: outcome and metrics, and their form as a line of JSON."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import re
from typing import Any, Dict, Mapping, Optional, Tuple

import numpy as np

from mbf_relay.lockstep.smoothness import Smoothness

SUCCEEDED = "SUCCEEDED"
CONTACT = "CONTACT"
TIMEOUT = "TIMEOUT"
ERROR = "ERROR"

CLOSE = 0.1
"""Clearance (m) below which time counts as close_time: about half the width of a turtlebot3 burger."""
PERSONAL_SPACE = 1.2
"""Distance (m) to a person below which a stranger is felt to be too near: the outer limit of personal distance in
Hall, The Hidden Dimension (1966)."""

MOST_BYTES = 180
"""Bytes of a world's name in a file name, which may have 255 with seed and ending."""


@dataclasses.dataclass(frozen=True)
class EpisodeResult:
    """One drive: its outcome and metrics, and computing times.

    Everything but `message` and `machine` depends on world, parameters and seed alone.

    Attributes:
        world: Name of the world.
        seed: Seed of all random numbers.
        success: All goals were reached, in time, without a contact.
        outcome: SUCCEEDED, CONTACT, TIMEOUT, ERROR (the episode could not be driven), or the name of navigation's
            outcome.
        message: Reason of the outcome, for people.
        goals_reached, goals: Number of goals reached, and of all.
        contacts: How often the robot came into contact with anything but the ground.
        contacts_at_fault: Those of them in which it moved towards what it touched, and was not pushed; see Touches.
        contact_times: Time (s) at which each contact began, from the start of the drive.
        time: Simulated seconds driven.
        time_limit: Simulated seconds allowed.
        path_length: Metres driven.
        smallest_clearance: Least distance (m) between the robot's hull and any body; None in an empty world.
        mean_clearance: Mean distance (m) between the robot's hull and the nearest body; None in an empty world.
        close_time: Seconds with less than CLOSE between hull and any body.
        closest_approach: Least distance (m) between the robot's hull and any mover; None where there are none.
        time_to_collision: Least time to collision (s) with any mover; None where they never approached each other.
        personal_space_time: Seconds with less than PERSONAL_SPACE between hull and any mover.
        recoveries: Number of recovery behaviours started.
        reference_path_length: Length (m) of a good path, where the world states one.
        score: BARN's score, see `score`; None where the world states no reference path.
        localization_error_mean, localization_error_max: Distance (m) between true and estimated position.
        heading_error_mean: Mean difference (rad) between true and estimated heading.
        final_error: Distance (m) between the true final position and the last goal.
        smoothness: See Smoothness.
        goal_times: Time (s) at which each goal was reached, from the start of the drive.
        goal_waits: How long (s) the estimated pose had been within the controller's tolerance of each goal by then;
            empty where the task's radius decides.
        trajectory: Shape (N, 6): time, true x, y, theta, forward and angular velocity (s, m, rad, m/s, rad/s), rounded
            for the file. Results are compared by `digest` instead.
        believed: Shape (N, 3): estimated x, y, theta at the same times.
        digest: Hash over the unrounded trajectory and all commanded velocities: equal digests are equal drives.
        machine: What depends on the machine: seconds per stage, wall time (s), memory (MiB).
    """

    world: str
    seed: int
    success: bool
    outcome: str
    message: str = ""
    goals_reached: int = 0
    goals: int = 0
    contacts: int = 0
    contacts_at_fault: int = 0
    contact_times: Tuple[float, ...] = ()
    time: float = 0.0
    time_limit: float = 0.0
    path_length: float = 0.0
    smallest_clearance: Optional[float] = None
    mean_clearance: Optional[float] = None
    close_time: float = 0.0
    closest_approach: Optional[float] = None
    time_to_collision: Optional[float] = None
    personal_space_time: float = 0.0
    recoveries: int = 0
    reference_path_length: Optional[float] = None
    score: Optional[float] = None
    localization_error_mean: float = 0.0
    localization_error_max: float = 0.0
    heading_error_mean: float = 0.0
    final_error: float = 0.0
    smoothness: Smoothness = Smoothness()
    goal_times: Tuple[float, ...] = ()
    goal_waits: Tuple[float, ...] = ()
    trajectory: np.ndarray = dataclasses.field(default_factory=lambda: np.empty((0, 6)), compare=False)
    believed: np.ndarray = dataclasses.field(default_factory=lambda: np.empty((0, 3)), compare=False)
    digest: str = ""
    machine: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def drive(self) -> Dict[str, Any]:
        """Return all fields that must be equal for equal seeds: all but `message` and `machine`."""
        return {name: value for name, value in self._fields().items() if name not in ("message", "machine")}

    @property
    def stem(self) -> str:
        """Name for this episode's files: the world's name with slashes and control characters escaped, and the seed."""
        name = re.sub("[/%\\x00-\\x1f]", lambda found: f"%{ord(found.group()):02X}", self.world)
        if len(name.encode()) > MOST_BYTES:
            whole = hashlib.sha256(name.encode()).hexdigest()[:16]
            name = f"{name.encode()[:MOST_BYTES - 17].decode(errors='ignore')}-{whole}"
        return f"{name}-{self.seed}"

    def to_line(self) -> str:
        """Return the result as one line of JSON."""
        return json.dumps(self._fields(), separators=(",", ":"))

    def _fields(self) -> Dict[str, Any]:
        return {
            **dataclasses.asdict(self), "trajectory": self.trajectory.tolist(), "believed": self.believed.tolist()}

    @classmethod
    def from_line(cls, line: str) -> EpisodeResult:
        """Return the result of a line by `to_line`; unknown fields are ignored.

        Raises:
            ValueError: The line is broken; the text says how.
        """
        values = json.loads(line)
        if not isinstance(values, dict):
            raise ValueError(f"is a {type(values).__name__}, not an object")
        known = {field.name for field in dataclasses.fields(cls)}
        missing = sorted({"world", "seed", "success", "outcome"} - set(values))
        if missing:
            raise ValueError(f"lacks {', '.join(missing)}")
        values = {name: value for name, value in values.items() if name in known}
        try:
            values["smoothness"] = Smoothness(**values.get("smoothness", {}))
            for name in ("contact_times", "goal_times", "goal_waits"):
                values[name] = tuple(values.get(name, ()))
            for name, columns in (("trajectory", 6), ("believed", 3)):  # arrays: thousands of results are held at once
                values[name] = np.array(values.get(name, ()), dtype=float).reshape(-1, columns)
            return cls(**values)
        except TypeError as error:
            raise ValueError(str(error)) from error


def failed(world: str, seed: int, message: str, reference_path_length: Optional[float] = None) -> EpisodeResult:
    """Return the result of an episode that could not be driven.

    Args:
        world, seed: Of the episode.
        message: Why it could not be driven.
        reference_path_length: Length (m) of the world's reference path; with one, score and SPL are 0, not missing.
    """
    return EpisodeResult(
        world, seed, False, ERROR, message, reference_path_length=reference_path_length,
        score=None if reference_path_length is None else 0.0,
    )


def score(success: bool, time: float, reference_path_length: float, top_speed: float) -> float:
    """Return the score of the BARN challenge: success x OT / clip(T, 2 OT, 8 OT).

    Args:
        success: Whether the goal was reached without a contact.
        time: T, the time taken (s).
        reference_path_length: Length (m) of the reference path; OT is its time at top speed.
        top_speed: The robot's top speed (m/s).
    """
    optimal = reference_path_length / top_speed
    return optimal / min(max(time, 2.0 * optimal), 8.0 * optimal) if success else 0.0
