"""What one episode came to."""

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
"""Metres between hull and obstacle below which a drive counts as close: half a burger's width."""
PERSONAL_SPACE = 1.2
"""Metres to a person within which a stranger is felt to be too near: Hall's personal distance (The Hidden Dimension,
1966)."""


MOST_BYTES = 180
"""Bytes of a world's name in a file's, which may have 255 with its ending."""


@dataclasses.dataclass(frozen=True)
class EpisodeResult:
    """One drive: what happened, how well, and (apart from it) how long the computer took.

    Everything but `message` and `machine` is decided by world, parameters and seed alone.

    Attributes:
        world: Name of the world.
        seed: Seed of everything random.
        success: All goals reached, in time, without a contact.
        outcome: SUCCEEDED, CONTACT, TIMEOUT, ERROR (the episode could not be driven), or the outcome navigation ended
            with.
        message: Why, for people.
        goals_reached, goals: How many of how many.
        contacts: How often the robot came to touch something that is not the ground.
        contacts_at_fault: Of them, those at which it moved towards what it touched; see Touches.
        contact_times: Seconds at which each contact began.
        time: Seconds driven, on the simulation's clock.
        time_limit: Seconds allowed.
        path_length: Metres driven.
        smallest_clearance: Least distance (m) between the robot's hull and anything standing; None where nothing
            stands.
        mean_clearance: The same distance over the whole drive, mean (m).
        close_time: Seconds within CLOSE of anything.
        closest_approach: Least distance (m) between the robot's hull and anything that moves by itself; None where
            nothing does.
        time_to_collision: Least time (s) to meeting what moves by itself, had both gone on closing in; None where they
            never did.
        personal_space_time: Seconds within PERSONAL_SPACE of anything that moves by itself.
        recoveries: How many recovery behaviours were begun.
        reference_path_length: Length (m) of a good way, where the world states one.
        score: Success weighed with the time taken (BARN's); None where the world states no reference path.
        localization_error_mean, localization_error_max: Metres between the true and the believed position.
        heading_error_mean: Radians between the true and the believed heading.
        final_error: Metres between the true final position and the last goal.
        smoothness: See Smoothness.
        goal_times: Seconds at which each goal was reached.
        goal_waits: Seconds for which it had believed itself within the controller's tolerance of each by then; empty
            where the task's radius decides.
        trajectory: Shape (N, 6): time, x, y, theta, forward and angular velocity of the truth (s, m, rad, m/s, rad/s),
            rounded for the file. Of two results that are compared the digest tells whether they differ in it.
        believed: Shape (N, 3): x, y, theta of what the robot believed at the same times.
        digest: Hash over the unrounded trajectory and every velocity commanded: equal digests are equal drives.
        machine: What depends on the machine and the day: seconds per stage, wall time, memory.
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
        """Return what equal seeds must give equally: everything but the texts and the machine's times."""
        return {name: value for name, value in self._fields().items() if name not in ("message", "machine")}

    @property
    def stem(self) -> str:
        """Name of files of this episode: its world's, without what a file system takes for a place, and its seed."""
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
        """Return the result a line holds.

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
            for name, columns in (("trajectory", 6), ("believed", 3)):  # thousands of results are held at once
                values[name] = np.array(values.get(name, ()), dtype=float).reshape(-1, columns)
            return cls(**values)
        except TypeError as error:
            raise ValueError(str(error)) from error


def failed(world: str, seed: int, message: str, reference_path_length: Optional[float] = None) -> EpisodeResult:
    """Return the result of an episode that could not be driven.

    Args:
        world, seed: Which.
        message: Why.
        reference_path_length: Metres; where the world states it, score and SPL are 0, and count as such.
    """
    return EpisodeResult(
        world, seed, False, ERROR, message, reference_path_length=reference_path_length,
        score=None if reference_path_length is None else 0.0,
    )


def score(success: bool, time: float, reference_path_length: float, top_speed: float) -> float:
    """Return BARN's score of one run.

    Success x OT / clip(T, 2 OT, 8 OT), OT the time of the reference path at top speed.
    """
    optimal = reference_path_length / top_speed
    return optimal / min(max(time, 2.0 * optimal), 8.0 * optimal) if success else 0.0
