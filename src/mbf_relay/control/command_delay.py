"""How late the robot does what it is told, seen in how it moves, and where it will be when it does the next."""

from __future__ import annotations

import math
from collections import deque
from typing import Collection, Deque, Iterable, Iterator, Tuple

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
"""Share of what the delay believed so far, or no command at all, leaves unexplained that a better one leaves.

One that is held as it sets out does what it was told before, to stand: no delay explains that better than none of them.
"""
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
    Wheels are told by more than one thread, and recoveries ask from their own: who reads goes through a copy, which is
    made in one piece.

    Attributes:
        seconds: From a command to the motion that odometry shows of it; 0.0 where that is little or not known.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._told: Deque[Tuple[float, Twist2D]] = deque()  # since when (s)
        self._seen: Deque[Tuple[float, Twist2D]] = deque()  # when (s)
        self._judged_from = math.inf
        self._judged_at = -math.inf

    def tell(self, now: float, velocity: Twist2D) -> None:
        """Take what the robot is told `now` (s), which holds until it is told otherwise; before all it was to stand."""
        told = self._told
        if told and now < told[-1][0]:  # time was set back
            told.clear()
        told.append((now, velocity))
        while len(told) > 1 and told[1][0] <= now - WATCHED - 2.0 * LONGEST:
            told.popleft()

    def note(self, now: float, velocity: Twist2D) -> None:
        """Take the robot's velocity `now` (s), as odometry has it, at the end of a cycle."""
        seen = self._seen
        if seen and not 0.0 < now - seen[-1][0] <= 1.0:  # the drive was interrupted, or time was set back
            seen.clear()
        if not seen:  # one that stands was told so before, too
            stands = not self._told_at(np.array([now])).any() and bool(np.all(np.abs(velocity) < LEAST))
            self._judged_from, self._judged_at = now + (0.0 if stands else LONGEST), now
        seen.append((now, velocity))
        while now - seen[0][0] > WATCHED + LONGEST:
            seen.popleft()
        if now - self._judged_at >= PERIOD - ROUNDING:
            self._judged_at = now
            self._judge(max(self._judged_from, now - WATCHED))

    def _told_at(self, times: np.ndarray) -> np.ndarray:
        """Return what the robot had been told just before each of the times (s), shape (..., 3)."""
        rows = np.array([(-math.inf, *STOP), *((since, *velocity) for since, velocity in list(self._told))])
        return np.asarray(rows[np.maximum(0, np.searchsorted(rows[:, 0], times) - 1), 1:])

    def _judge(self, begin: float) -> None:
        """Take what the cycles from `begin` (s) on say."""
        rows = np.array([(time, *velocity) for time, velocity in list(self._seen) if time >= begin]).reshape(-1, 4)
        if len(rows) < ENOUGH:
            return
        times, seen = rows[:, 0], rows[:, 1:]
        told = self._told_at(times - DELAYS[:, None])
        power = np.mean(told[0] ** 2, axis=0)  # the first delay is none
        known = power > LEAST ** 2
        if not known.any():
            return
        errors = np.mean((seen[:, known] - told[..., known]) ** 2, axis=1)
        unexplained = (errors / power[known]).sum(axis=1)
        best = int(np.argmin(unexplained))
        believed = unexplained[np.searchsorted(DELAYS, self.seconds)]
        stood = (np.mean(seen[:, known] ** 2, axis=0) / power[known]).sum()  # as by no command at all
        if unexplained[best] < min(believed - GAIN, EXPLAINED * min(believed, stood)):
            self.seconds = float(DELAYS[best]) if DELAYS[best] >= LATE else 0.0

    def told_lately(self) -> Twist2D:
        """Return what it was told between the last two cycles, on the mean: less than the last where that came late."""
        seen, told = self._seen, list(self._told)
        if len(seen) < 2:
            return told[-1][1] if told else STOP
        begin, end = seen[-2][0], seen[-1][0]
        x, y, theta, until = 0.0, 0.0, 0.0, end
        for since, velocity in reversed(told):
            share = max(0.0, until - max(since, begin)) / (end - begin)
            x, y, theta = x + share * velocity.x, y + share * velocity.y, theta + share * velocity.theta
            until = min(since, until)
            if until <= begin:
                break
        return Twist2D(x, y, theta)

    def caught_up(self, pose: Pose2D, age: float) -> Pose2D:
        """Return where a robot is in the last cycle that was at `pose` `age` (s) before, as its velocities tell."""
        seen = list(self._seen)
        since = seen[-1][0] - age if seen else math.inf
        for time, velocity in seen:
            if time > since:
                pose, since = pose.compose(velocity.held(time - since)), time
        return pose

    def way(self, pose: Pose2D, step: float, turn_step: float, ahead: float = 0.0) -> np.ndarray:
        """Return the poses that lead from where a robot is in the last cycle to where it does what it is told next.

        Args:
            pose: Where it is.
            step, turn_step: Metres and radians from pose to pose, at most.
            ahead: By how much (s) `pose` is newer than the velocities noted: so much of the way lies behind it.

        Returns:
            Shape (P, 3); the last one is where it will be, `pose` itself where nothing comes late.
        """
        seen = list(self._seen)
        if self.seconds <= ahead or not seen:
            return np.array([pose])
        end = seen[-1][0]
        return way_held(pose, held_between(list(self._told), end - (self.seconds - ahead), end), step, turn_step)


def held_between(
    told: Collection[Tuple[float, Twist2D]], begin: float, end: float
) -> Iterator[Tuple[Twist2D, float]]:
    """Yield what was held between two times (s), and for how long (s), of velocities and since when (s) each was."""
    ends = [since for since, _ in told][1:] + [end]
    for (since, velocity), until in zip(told, ends):
        duration = min(until, end) - max(since, begin)
        if duration > 0.0:
            yield velocity, duration


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
