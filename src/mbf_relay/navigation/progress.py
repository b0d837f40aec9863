"""Progress checks: oscillation by distance and angle, and a robot that stands still against its commands."""

from __future__ import annotations

from typing import Optional

from mbf_relay.control.checkers import CAR
from mbf_relay.geometry import IDENTITY, Pose2D, Twist2D, angle_between
from mbf_relay.navigation.goals import FollowFeedback
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.outcomes import ControlOutcome
from mbf_relay.timing import Stopwatch

STOPPED = 1e-3
"""Speed (m/s and rad/s) below which a robot counts as standing, and a command as zero."""
MOVED = 0.02, 0.05
"""Distance (m) and angle (rad) above which a robot has moved; above the noise of the pose of one that stands."""
TOLD_AFTER = 1.0
"""Seconds for which a robot stands still against its commands before feedback says so, as in Move Base Flex's log."""
ONE_WAY = 0.5
"""Net turn (rad) that counts as progress at the timeout where the robot turned one way; one that oscillates turns back.
"""
MOSTLY = 0.9
"""Smallest ratio of net turn to the sum of all turning for a turn to count as one way."""


class OscillationDetector:
    """Detects a robot that has neither moved oscillation_distance nor turned oscillation_angle within the timeout."""

    def __init__(self) -> None:
        self._reference: Optional[Pose2D] = None
        self._heading = 0.0
        self._turned = self._turned_in_all = 0.0
        self._since, self._asked = Stopwatch(), Stopwatch()

    @property
    def running(self) -> bool:
        """Return whether the timeout has been started."""
        return self._since.running

    def restart(self, now: float) -> None:
        """Start the timeout over."""
        self._reference = None
        self._since.start(now)
        self._asked.start(now)

    def wait(self, now: float) -> None:
        """Leave the time since the last call out of the timeout, as while there is no velocity to drive by."""
        self._since.leave_out(self._asked.elapsed(now))
        self._asked.start(now)

    def progressed(self, now: float, pose: Pose2D, parameters: NavigatorParameters) -> bool:
        """Take a pose; return whether the robot made progress since the last reference pose.

        Turns between poses are summed, since the angle between two headings is below pi. At the timeout a smaller turn
        is accepted from a slow robot that turned one way (ONE_WAY, MOSTLY).
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
        """Return the time (s) without progress if it exceeds oscillation_timeout, otherwise None."""
        elapsed = self._since.elapsed(now)
        timeout = parameters.oscillation_timeout
        return elapsed if timeout > 0.0 and elapsed > timeout else None


class GoalProgress:
    """Checks a move_base goal for oscillation, over all its drives and replans, and says what hindered the robot."""

    def __init__(self) -> None:
        self._oscillation = OscillationDetector()
        self._refusal = ""

    def await_start(self, now: float, paused: bool) -> None:
        """Start the timeout at the first call, and start it over while the robot is paused."""
        if paused or not self._oscillation.running:
            self.restart(now)

    def restart(self, now: float) -> None:
        """Start the timeout over."""
        self._oscillation.restart(now)

    def wait(self, now: float) -> None:
        """Leave the time since the last call of this or of `trouble` out of the timeout: there was no path to drive."""
        self._oscillation.wait(now)

    def trouble(self, now: float, feedback: FollowFeedback, parameters: NavigatorParameters) -> str:
        """Take a drive's feedback; return why the robot counts as oscillating, empty where it does not."""
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
    """Detects a robot that stands still while it is commanded to move.

    Its pose is compared too: with a controller at 1 Hz and a base that stops 0.5 s after each command, odometry tells a
    velocity of zero in every cycle although the robot moves on.
    """

    def __init__(self) -> None:
        self._since = Stopwatch()
        self._place = IDENTITY

    def ignored_for(self, now: float, command: Twist2D, velocity: Twist2D, pose: Pose2D) -> float:
        """Return for how long (s) the robot has stood still against its commands.

        Args:
            now: Time (s) of the cycle.
            command, velocity: Commanded and measured, body frame (m/s, rad/s).
            pose: The robot's, always in the same frame.
        """
        if not _is_zero(velocity) or _is_zero(command):
            self._since.reset()
        elif not self._since.running or self._place.is_apart(pose, *MOVED):
            self._since.start(now)
            self._place = pose
        return self._since.elapsed(now)

    def told(self, now: float, command: Twist2D) -> str:
        """Return the message for the user: for how long it has stood still, and the last command."""
        on_the_spot = CAR if command.speed() < STOPPED else ""
        return (
            f"Robot has stood still for {self._since.elapsed(now):.1f} s against velocity commands, the last one of "
            f"{command.speed():.2f} m/s and {command.theta:.2f} rad/s{on_the_spot}")


def _is_zero(velocity: Twist2D) -> bool:
    return velocity.speed() < STOPPED and abs(velocity.theta) < STOPPED
