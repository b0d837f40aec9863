"""Is the robot getting anywhere? Oscillation by distance and angle, and commands that move nothing."""

from __future__ import annotations

from typing import Optional

from mbf_relay.control.checkers import CAR
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D, angle_between
from mbf_relay.navigation.goals import FollowFeedback
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.outcomes import ControlOutcome
from mbf_relay.timing import Stopwatch

STOPPED = 1e-3
"""m/s and rad/s below which a robot counts as standing and a command as zero."""
MOVED = 0.02, 0.05
"""Metres and radians by which a robot that stands is somewhere else: more than its poses differ while it does."""
ONE_WAY = 0.5
"""Radians of a turn that is progress, however slow, where it went one way: a robot that oscillates turns back."""
MOSTLY = 0.9
"""Share of all its turning that such a turn is at least."""


class OscillationDetector:
    """Notices a robot that neither moved nor turned far enough for too long."""

    def __init__(self) -> None:
        self._reference: Optional[Pose2D] = None
        self._heading = 0.0
        self._turned = self._turned_in_all = 0.0
        self._since, self._asked = Stopwatch(), Stopwatch()

    @property
    def running(self) -> bool:
        """Return whether time counts yet."""
        return self._since.running

    def restart(self, now: float) -> None:
        """Give the robot the whole timeout again."""
        self._reference = None
        self._since.start(now)
        self._asked.start(now)

    def wait(self, now: float) -> None:
        """Let the time since the last call not count: nobody could say where to drive."""
        self._since.leave_out(self._asked.elapsed(now))
        self._asked.start(now)

    def progressed(self, now: float, pose: Pose2D, parameters: NavigatorParameters) -> bool:
        """Take a pose; return whether it is far enough from the last one that counted.

        Turns are summed up, as the angle between two headings never says how often a robot went round. Whoever has not
        turned far enough in time may be slow to turn: then what counts is whether that went one way.
        """
        self._asked.start(now)
        if self._reference is None:
            self._take_as_reference(pose)
            if not self._since.running:
                self._since.start(now)
            return False
        turn = angle_between(self._heading, pose.theta)
        self._turned += turn
        self._turned_in_all += abs(turn)
        self._heading = pose.theta
        moved = self._reference.distance_to(pose) >= parameters.oscillation_distance
        turned = abs(self._turned) >= parameters.oscillation_angle or (
            self.stuck_for(now, parameters) is not None
            and abs(self._turned) >= max(ONE_WAY, MOSTLY * self._turned_in_all))
        if moved or turned:
            self.restart(now)
            self._take_as_reference(pose)
        return moved or turned

    def _take_as_reference(self, pose: Pose2D) -> None:
        self._reference, self._heading, self._turned, self._turned_in_all = pose, pose.theta, 0.0, 0.0

    def stuck_for(self, now: float, parameters: NavigatorParameters) -> Optional[float]:
        """Return for how long (s) there was no progress where that is too long, otherwise None."""
        elapsed = self._since.elapsed(now)
        timeout = parameters.oscillation_timeout
        return elapsed if timeout > 0.0 and elapsed > timeout else None


class GoalProgress:
    """Judges a whole goal, over drives, replans and recoveries, and says why its robot got nowhere."""

    def __init__(self) -> None:
        self._oscillation = OscillationDetector()
        self._refusal = ""

    def await_start(self, now: float, paused: bool) -> None:
        """Let no time count while the robot is paused, nor before the first call."""
        if paused or not self._oscillation.running:
            self.restart(now)

    def restart(self, now: float) -> None:
        """Give the robot the whole timeout again."""
        self._oscillation.restart(now)

    def wait(self, now: float) -> None:
        """Let the time since the last call, of this or of `trouble`, not count: there was no path to drive."""
        self._oscillation.wait(now)

    def trouble(self, now: float, feedback: FollowFeedback, parameters: NavigatorParameters) -> str:
        """Take what a drive tells; return why the goal is to be given up as oscillating, empty where it is not."""
        if feedback.pose is None or parameters.oscillation_timeout <= 0.0:
            return ""
        if feedback.is_unasked:
            self._oscillation.wait(now)
            return ""
        if self._oscillation.progressed(now, feedback.pose.pose, parameters):
            self._refusal = ""
            return ""
        if feedback.outcome is not ControlOutcome.SUCCESS:
            self._refusal = f"the controller last said {feedback.outcome.name}: {feedback.message}"
        stuck = self._oscillation.stuck_for(now, parameters)
        if stuck is None:
            return ""
        why = self._refusal or (
            f"no velocity was refused, the last one is {feedback.velocity.speed():.2f} m/s and "
            f"{feedback.velocity.theta:.2f} rad/s, {feedback.distance:.2f} m before the goal"
        )
        if feedback.late > 0.0:
            why = f"it moves as it was told {feedback.late:.2f} s before, so commands reach its wheels late; {why}"
        return f"Robot is oscillating for {stuck:.1f} s: {why}"


class IgnoredCommands:
    """Notices a robot that stands while it is told to move.

    One whose wheels stop by themselves before the next command, as of a controller of 1 Hz and a base that heeds each
    for half a second, stands at every look, and is somewhere else each time.
    """

    def __init__(self) -> None:
        self._since = Stopwatch()
        self._place = IDENTITY

    def ignored_for(self, now: float, command: Twist2D, velocity: Twist2D, pose: Pose2D) -> float:
        """Take a cycle's command and the robot's velocity and pose; return for how long (s) it has ignored commands."""
        if not _is_zero(velocity) or _is_zero(command):
            self._since.reset()
        elif not self._since.running or self._place.is_apart(pose, *MOVED):
            self._since.start(now)
            self._place = pose
        return self._since.elapsed(now)

    def told(self, now: float, command: Twist2D) -> str:
        """Return for how long it has ignored commands, and the last one."""
        on_the_spot = CAR if command.speed() < STOPPED else ""
        return (
            f"Robot has stood still for {self._since.elapsed(now):.1f} s against velocity commands, the last one of "
            f"{command.speed():.2f} m/s and {command.theta:.2f} rad/s{on_the_spot}")


def _is_zero(velocity: Twist2D) -> bool:
    return velocity.speed() < STOPPED and abs(velocity.theta) < STOPPED
