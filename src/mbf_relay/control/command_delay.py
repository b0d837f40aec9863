"""How late the robot does what it is told, seen in how it moves, and where it will be when it does the next."""

from __future__ import annotations

import math
from collections import deque
from typing import Deque, Iterable, Tuple

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
PERIOD = 0.5
"""Seconds after which it is told anew: a comparison takes as long as a third of a cycle of DWA."""
LONGEST = float(DELAYS[-1])
"""Seconds: the longest delay looked for."""
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
            self._judged_from, self._judged_at = now + (0.0 if stands else LONGEST), now
        cycles.append((now, commanded, velocity))
        while now - cycles[0][0] > WATCHED + LONGEST:
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

    def way(self, pose: Pose2D, step: float, turn_step: float) -> np.ndarray:
        """Return the poses that lead from where a robot is in the last cycle to where it does what it is told next.

        Args:
            pose: Where it is.
            step, turn_step: Metres and radians from pose to pose, at most.

        Returns:
            Shape (P, 3); the last one is where it will be, `pose` itself where nothing comes late.
        """
        if self.seconds == 0.0:
            return np.array([pose])
        begin = since = self._cycles[-1][0] - self.seconds
        held = []
        for end, told, _ in self._cycles:
            if end > begin:
                held.append((told, end - since))
                since = end
        return way_held(pose, held, step, turn_step)


def way_held(pose: Pose2D, held: Iterable[Tuple[Twist2D, float]], step: float, turn_step: float) -> np.ndarray:
    """Return the poses on which velocities lead that are held one after the other, shape (P, 3).

    Args:
        pose: Where that begins; of no velocity it is the only one.
        held: Velocities (body frame), and how long each is held (s).
        step, turn_step: Metres and radians from pose to pose, at most.
    """
    poses = [pose]
    for velocity, duration in held:
        count = math.ceil(max(velocity.speed() / step, abs(velocity.theta) / turn_step) * duration)
        begin = poses[-1]
        poses += [begin.compose(velocity.held(duration * part / count)) for part in range(1, count + 1)]
    return np.array(poses[1:] or poses)
