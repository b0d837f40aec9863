"""How late the robot does what it is told, seen in how it turns."""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, Tuple

import numpy as np

from mbf_relay.geometry import angle_between

WATCHED = 10.0
"""Seconds of commands and headings that are kept."""
STEP = 0.05
"""Seconds from one delay tried to the next, and over which a turn is taken."""
LONGEST = 1.5
"""Seconds: the longest delay looked for."""
LATE = 0.3
"""Seconds from which commands are late; wheels that gain speed slowly look late by half of what they take."""
TURNS = 0.05
"""Radians per second of turning, on the mean, below which nothing can be told."""
EXPLAINED = 0.5
"""Share of what the commands of the moment leave unexplained of the turns that late ones leave at most."""


class CommandDelay:
    """Compares how a robot turns with what it was told before, cycle by cycle."""

    def __init__(self) -> None:
        self._cycles: Deque[Tuple[float, float, float]] = deque()

    def note(self, now: float, turn: float, heading: float) -> None:
        """Take a cycle.

        Args:
            now: Seconds.
            turn: Commanded from now on (rad/s).
            heading: Of the robot now (rad), in a frame that does not turn.
        """
        cycles = self._cycles
        if cycles and not 0.0 < now - cycles[-1][0] <= 1.0:
            cycles.clear()  # the drive was interrupted, or time was set back
        if cycles:
            heading = cycles[-1][2] + angle_between(cycles[-1][2], heading)  # goes on beyond a half turn
        cycles.append((now, turn, heading))
        while now - cycles[0][0] > WATCHED:
            cycles.popleft()

    def late_by(self) -> float:
        """Return by how many seconds the robot turns later than it is told; 0.0 where that is little or not known."""
        if not self._cycles or self._cycles[-1][0] - self._cycles[0][0] < 2.0 * LONGEST:
            return 0.0
        times, turns, headings = np.array(self._cycles).T
        starts = np.arange(times[0] + LONGEST, times[-1] - STEP, STEP)
        turned = (np.interp(starts + STEP, times, headings) - np.interp(starts, times, headings)) / STEP
        if math.sqrt(np.mean(turned ** 2)) < TURNS:
            return 0.0
        delays = np.arange(0.0, LONGEST, STEP)
        told = turns[np.searchsorted(times, starts[None, :] + 0.5 * STEP - delays[:, None], side="right") - 1]
        unexplained = np.mean((turned - told) ** 2, axis=1)
        best = int(np.argmin(unexplained))
        if delays[best] < LATE or unexplained[best] > EXPLAINED * unexplained[0]:
            return 0.0
        return float(delays[best])
