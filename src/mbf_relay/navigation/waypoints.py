"""The order of waypoints: which one is next, when to go there, and when all are done."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Optional

from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.timing import Stopwatch


@dataclass(frozen=True)
class WaypointFollowerParameters(ParameterSet):
    """Parameters of `waypoint_follower`, by the names of the package follow_waypoints, where it has them.

    They hold for what comes by its topics; goals of the action say theirs.
    """

    goal_frame_id: str = parameter("map", "frame of poses whose header names none", is_frame=True)
    addpose_topic: str = parameter(
        "initialpose", "topic on which waypoints are added; initialpose is RViz's 2D Pose Estimate", is_topic=True)
    wait_duration: float = parameter(
        0.0, "how long to stand at each waypoint; 0 to go on at once", unit="s", minimum=0.0)
    number_of_loops: int = parameter(0, "how often to drive the waypoints again after the first time", minimum=0)
    stop_on_failure: bool = parameter(
        False, "stop at the first waypoint that is not reached; false goes on to the next")


class WaypointFollower:
    """Says which waypoint to drive to and when; `ended` is called after each drive.

    Attributes:
        current: Index of the present waypoint.
        loop: Number of completed rounds.
        missed: Index of each waypoint that was not reached, in the order of the drives.
    """

    def __init__(self, count: int, loops: int = 0, first: int = 0, pause: float = 0.0, stops: bool = False) -> None:
        """Begin.

        Args:
            count: Number of waypoints.
            loops: Number of further rounds after the first.
            first: Index of the first waypoint.
            pause: Time (s) to stand at each waypoint that was reached.
            stops: Whether to end at the first waypoint that is not reached.

        Raises:
            ValueError: There are no waypoints, `first` is out of range, or the pause is negative or not finite.
        """
        if count == 0:
            raise ValueError("there are no poses; give at least one")
        if first >= count:
            raise ValueError(f"goal_index is {first}; there are {count} poses, counted from 0")
        if not 0.0 <= pause < float("inf"):
            raise ValueError(f"waypoint_pause_duration is {pause} s; it must be 0 or more")
        self._count, self._loops, self._pause, self._stops = count, loops, pause, stops
        self.current, self.loop = first, 0
        self.missed: List[int] = []
        self._ahead: Optional[int] = first
        self._standing, self._wait = Stopwatch(), 0.0

    @property
    def is_over(self) -> bool:
        """Whether no waypoint is left."""
        return self._ahead is None

    @property
    def has_failed(self) -> bool:
        """Whether it is over because a waypoint was not reached."""
        return self._stops and bool(self.missed)

    def next_waypoint(self, now: float) -> Optional[int]:
        """Return the index of the waypoint to drive to at `now` (s), None while the robot is to stand."""
        if self._ahead is None or self._standing.elapsed(now) < self._wait:
            return None
        self.current = self._ahead
        return self._ahead

    def ended(self, now: float, reached: bool) -> None:
        """Record that the drive to the current waypoint ended at `now` (s)."""
        if not reached:
            self.missed.append(self.current)
        last = self.current + 1 == self._count
        if self.has_failed or (last and self.loop >= self._loops):
            self._ahead = None
            return
        self._ahead = 0 if last else self.current + 1
        self.loop += int(last)
        self._wait = self._pause if reached else 0.0
        self._standing.start(now)
