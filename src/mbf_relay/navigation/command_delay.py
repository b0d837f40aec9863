"""How late the robot does what it is told, seen in how it moves, and where it will be when it does the next."""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, Tuple

import numpy as np

from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.timing import ROUNDING

WATCHED = 5.0
"""Seconds of motion that are compared with commands."""
DELAYS = np.arange(0.0, 1.5, 0.05)
"""Seconds: the delays looked for."""
LATE = 0.15
"""Seconds from which commands are late; odometry and wheels that gain speed take a third of that in any case."""
LEAST = np.array([0.02, 0.02, 0.05])
"""Metres and radians per second of what was commanded, on the mean, below which nothing is told by that component."""
EXPLAINED = 0.5
"""Share of what the delay believed so far, or no command at all, leaves unexplained that a better one leaves."""
GAIN = 0.1
"""By how much more of the commands' squares a better delay explains at least."""
PERIOD = 0.1
"""Seconds after which it is told anew."""
ENOUGH = 5
"""Cycles from which something can be told."""


class CommandDelay:
    """Compares how a robot moves with what it was told before, cycle by cycle.

    What it found holds until the robot's motion says otherwise: one that stands, or drives on as before, says nothing.

    Attributes:
        seconds: From a command to the motion that odometry shows of it; 0.0 where that is little or not known.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._cycles: Deque[Tuple[float, Twist2D, Twist2D]] = deque()  # end (s), what was told in it, seen at its end
        self._judged_from = math.inf
        self._judged_at = -math.inf

    def note(self, now: float, commanded: Twist2D, velocity: Twist2D) -> None:
        """Take a cycle.

        Args:
            now: Seconds.
            commanded: Since the last cycle.
            velocity: Of the robot now, as odometry has it.
        """
        cycles = self._cycles
        if cycles and not 0.0 < now - cycles[-1][0] <= 1.0:  # the drive was interrupted, or time was set back
            cycles.clear()
        if not cycles:  # one that stands was told so before, too
            stands = commanded == STOP and bool(np.all(np.abs(velocity) < LEAST))
            self._judged_from, self._judged_at = now + (0.0 if stands else DELAYS[-1]), now
        cycles.append((now, commanded, velocity))
        while now - cycles[0][0] > WATCHED + DELAYS[-1]:
            cycles.popleft()
        if now - self._judged_at >= PERIOD - ROUNDING:
            self._judged_at = now
            self._judge(max(self._judged_from, now - WATCHED))

    def _judge(self, begin: float) -> None:
        """Take what the cycles from `begin` (s) on say."""
        rows = np.array([(end, *told, *seen) for end, told, seen in self._cycles])
        ends, told, seen = rows[:, 0], rows[:, 1:4], rows[:, 4:]
        first = int(np.searchsorted(ends, begin))
        if len(ends) - first < ENOUGH:
            return
        power = np.mean(told[first:] ** 2, axis=0)
        known = power > LEAST ** 2
        if not known.any():
            return
        in_force = np.searchsorted(ends, ends[first:] - DELAYS[:, None])
        errors = np.mean((seen[first:, known] - told[in_force][..., known]) ** 2, axis=1)
        unexplained = (errors / power[known]).sum(axis=1)
        best = int(np.argmin(unexplained))
        believed = unexplained[np.searchsorted(DELAYS, self.seconds)]
        if unexplained[best] <= min(believed - GAIN, EXPLAINED * min(believed, np.count_nonzero(known))):
            self.seconds = float(DELAYS[best]) if DELAYS[best] >= LATE else 0.0

    def ahead(self, pose: Pose2D) -> Pose2D:
        """Return where a robot that is at `pose` in the last cycle will be when it does what it is told next."""
        if self.seconds == 0.0:
            return pose
        begin = since = self._cycles[-1][0] - self.seconds
        for end, told, _ in self._cycles:
            if end > begin:
                pose = pose.compose(told.held(end - since))
                since = end
        return pose
