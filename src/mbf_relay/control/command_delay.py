"""Estimation of the delay between commands and the robot's motion, and prediction of its pose across that delay."""

from __future__ import annotations

import math
from collections import deque
from typing import Collection, Deque, Iterable, Iterator, Tuple

import numpy as np

from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.timing import ROUNDING

WATCHED = 5.0
"""Time (s) of odometry that is compared with the commands."""
DELAYS = np.arange(0.0, 1.5, 0.05)
"""Delays (s) tried."""
LATE = 0.15
"""Delay (s) below which 0 is reported: odometry and acceleration alone cause a third of that."""
LEAST = np.array([0.02, 0.02, 0.05])
"""Root mean square of the commands (m/s, m/s, rad/s) up to which a component is not used for the estimate."""
EXPLAINED = 0.5
"""A new delay is taken only if its error is below this share of that of the present delay, and of that of a command to
stand. A robot that is held fast as it sets out fits a command to stand: its motion says nothing of a delay."""
GAIN = 0.1
"""Least decrease of the error, as a share of the commands' mean squares, for which a new delay is taken."""
PERIOD = 0.5
"""Time (s) between two estimates: one takes a third of the time of a DWA cycle."""
LONGEST = float(DELAYS[-1])
"""Longest delay (s) tried."""
ENOUGH = 5
"""Least number of odometry samples for an estimate."""


class CommandDelay:
    """Estimates the delay by the least squares error between measured velocities and delayed commands.

    An estimate holds until motion contradicts it; a robot that stands or keeps its velocity gives no information.
    Threads: commands come from several, and recoveries read from their own. Readers iterate over a copy of the deque,
    which list() makes atomically.

    Attributes:
        seconds: Delay from a command to the motion that odometry shows; 0.0 where that is below LATE or not known.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._told: Deque[Tuple[float, Twist2D]] = deque()  # since when (s)
        self._seen: Deque[Tuple[float, Twist2D]] = deque()  # when (s)
        self._judged_from = math.inf
        self._judged_at = -math.inf

    def tell(self, now: float, velocity: Twist2D) -> None:
        """Note the command sent at `now` (s). It holds until the next one; before the first the robot was to stand."""
        told = self._told
        if told and now < told[-1][0]:  # time was set back
            told.clear()
        told.append((now, velocity))
        while len(told) > 1 and told[1][0] <= now - WATCHED - 2.0 * LONGEST:
            told.popleft()

    def note(self, now: float, velocity: Twist2D) -> None:
        """Note the velocity that odometry measured at `now` (s), once per cycle, and estimate anew after PERIOD."""
        seen = self._seen
        if seen and not 0.0 < now - seen[-1][0] <= 1.0:  # the drive was interrupted, or time was set back
            seen.clear()
        if not seen:  # of a standing robot earlier commands are known as well: to stand
            stands = not self._told_at(np.array([now])).any() and bool(np.all(np.abs(velocity) < LEAST))
            self._judged_from, self._judged_at = now + (0.0 if stands else LONGEST), now
        seen.append((now, velocity))
        while now - seen[0][0] > WATCHED + LONGEST:
            seen.popleft()
        if now - self._judged_at >= PERIOD - ROUNDING:
            self._judged_at = now
            self._judge(max(self._judged_from, now - WATCHED))

    def _told_at(self, times: np.ndarray) -> np.ndarray:
        """Return the command in force just before each of the times (s), shape (..., 3)."""
        rows = np.array([(-math.inf, *STOP), *((since, *velocity) for since, velocity in list(self._told))])
        return np.asarray(rows[np.maximum(0, np.searchsorted(rows[:, 0], times) - 1), 1:])

    def _judge(self, begin: float) -> None:
        """Estimate the delay from the odometry since `begin` (s)."""
        rows = np.array([(time, *velocity) for time, velocity in list(self._seen) if time >= begin]).reshape(-1, 4)
        if len(rows) < ENOUGH:
            return
        times, seen = rows[:, 0], rows[:, 1:]
        undelayed, believed = self._told_at(times - np.array([[0.0], [self.seconds]]))
        power = np.mean(undelayed ** 2, axis=0)
        known = power > LEAST ** 2
        if not known.any():
            return

        def unexplained(told: np.ndarray) -> np.ndarray:
            errors = np.mean((seen[:, known] - told[..., known]) ** 2, axis=-2)
            return np.asarray((errors / power[known]).sum(axis=-1))

        now = float(unexplained(believed))
        if now <= GAIN:  # as nearly always: no other delay can be better by GAIN
            return
        left = unexplained(self._told_at(times - DELAYS[:, None]))
        best, stood = int(np.argmin(left)), float(unexplained(np.zeros(3)))  # as by no command at all
        if left[best] < min(now - GAIN, EXPLAINED * min(now, stood)):
            self.seconds = float(DELAYS[best]) if DELAYS[best] >= LATE else 0.0

    def told_lately(self) -> Twist2D:
        """Return the mean command (body frame) between the last two cycles."""
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
        """Return a pose that is `age` (s) older than the last odometry, moved on by the velocities noted since."""
        seen = list(self._seen)
        since = seen[-1][0] - age if seen else math.inf
        for time, velocity in seen:
            if time > since:
                pose, since = pose.compose(velocity.held(time - since)), time
        return pose

    def way(self, pose: Pose2D, step: float, turn_step: float, ahead: float = 0.0) -> np.ndarray:
        """Return the poses from where the robot is now to where the next command takes effect.

        Args:
            pose: Where it is now.
            step, turn_step: Largest spacing (m, rad) of the poses.
            ahead: Time (s) by which `pose` is newer than the last odometry; that part of the way is left out.

        Returns:
            Shape (P, 3); the last one is the predicted pose, `pose` itself without a delay.
        """
        seen = list(self._seen)
        if self.seconds <= ahead or not seen:
            return np.array([pose])
        end = seen[-1][0]
        return way_held(pose, held_between(list(self._told), end - (self.seconds - ahead), end), step, turn_step)


def held_between(
    told: Collection[Tuple[float, Twist2D]], begin: float, end: float
) -> Iterator[Tuple[Twist2D, float]]:
    """Yield (velocity, duration in s) between two times (s), from a row of (start time in s, velocity)."""
    ends = [since for since, _ in told][1:] + [end]
    for (since, velocity), until in zip(told, ends):
        duration = min(until, end) - max(since, begin)
        if duration > 0.0:
            yield velocity, duration


def way_held(pose: Pose2D, held: Iterable[Tuple[Twist2D, float]], step: float, turn_step: float) -> np.ndarray:
    """Return the poses along velocities that are held one after the other, shape (P, 3).

    Args:
        pose: Start, left out of the result unless there is nothing else.
        held: Velocities (body frame), each with its duration (s).
        step, turn_step: Largest spacing (m, rad) of the poses.
    """
    poses = [pose]
    for velocity, duration in held:
        count = math.ceil(max(velocity.speed() / step, abs(velocity.theta) / turn_step) * duration)
        begin = poses[-1]
        poses += [begin.compose(velocity.held(duration * part / count)) for part in range(1, count + 1)]
    return np.array(poses[1:] or poses)
