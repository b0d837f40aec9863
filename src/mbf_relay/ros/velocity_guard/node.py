"""The velocity_guard node: passes `cmd_vel_raw` on to `cmd_vel` while the lidar shows room to brake."""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Deque, Dict, Optional

import numpy as np
import rospy
from geometry_msgs.msg import Polygon, Twist
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String

from mbf_relay.control.steering import Steering
from mbf_relay.control.velocity_guard import NO_SCAN, PASSING, STANDING, VelocityGuard, Verdict
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.costmap.outline import padded
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.outcomes import StaleDataError
from mbf_relay.ros.common import diagnostics, parameters
from mbf_relay.ros.common.clock_watch import ClockWatch
from mbf_relay.ros.common.conversions import dated, twist_to_message
from mbf_relay.ros.common.node import on_shutdown, one_line, spare_what_stays
from mbf_relay.ros.common.odometry import OdometryInput
from mbf_relay.ros.common.outlines import outline_from_message
from mbf_relay.ros.velocity_guard.lidars import MOTION_AGE, WARN_PERIOD, Lidars

LOOK_PERIOD = 0.1
"""Wall seconds after which the last velocity is checked again without a new velocity or scan."""
MOST_SCANS = 10
"""Largest number of waiting scans, of all lidars on the topic; of each lidar only the newest is used."""
IDLE_PERIOD = 0.5
"""Wall seconds between two checks while the robot stands."""
ALONE_FOR = 20.0
"""Wall seconds without a publisher of `cmd_vel_raw` after which that is logged, once."""


class VelocityGuardNode:
    """Topics of the guard; the decisions are made by mbf_relay.control.velocity_guard.

    The main thread does everything; callbacks only store the newest velocity and scans, and wake it.
    """

    def __init__(self, settings: VelocityGuardParameters) -> None:
        self._settings = settings
        self._guard = VelocityGuard(settings)
        self._steering = Steering(settings.wheelbase) if settings.wheelbase else None
        self._odometry = OdometryInput("odom")
        self._lidars = Lidars(settings.base_frame, self._odometry)
        self._clock = ClockWatch()
        self._woken = threading.Event()
        self._commanded: Deque[Twist] = deque(maxlen=1)  # the newest, until it is checked
        self._scans: Deque[LaserScan] = deque(maxlen=MOST_SCANS)
        self._outlines: Deque[np.ndarray] = deque(maxlen=1)  # the newest, as of a robot that took up a load
        self._sending = threading.Lock()  # held while a velocity is sent, so that none follows the last zero
        self._closed = False
        self._verdict = Verdict(STOP, STANDING, "standing: no velocity is asked for")
        self._counts: Dict[str, int] = {}
        self._state = rospy.Publisher("~state", String, queue_size=1, latch=True)
        self._state.publish(self._verdict.text)
        self._velocity = rospy.Publisher("cmd_vel", Twist, queue_size=1, tcp_nodelay=True)
        on_shutdown(self.close)
        self._commands = rospy.Subscriber("cmd_vel_raw", Twist, self._take_command, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber("scan", LaserScan, self._take_scan, queue_size=MOST_SCANS, buff_size=1 << 18, tcp_nodelay=True)
        rospy.Subscriber("~footprint", Polygon, self._take_footprint, queue_size=1)
        self._alone_since = time.monotonic()
        diagnostics.Diagnostics().add("velocities", self._report)

    def run(self) -> None:
        """Pass velocities on until ROS is shut down."""
        while not rospy.is_shutdown():
            self._woken.wait(IDLE_PERIOD if self._verdict.velocity == STOP else LOOK_PERIOD)
            self._woken.clear()
            if self._outlines:
                self._guard.set_outline(self._outlines.pop())
            self._step(rospy.get_time())

    def close(self) -> None:
        """Send a zero velocity, and nothing afterwards."""
        with self._sending:
            self._closed = True
            self._velocity.publish(twist_to_message(STOP))

    def _take_command(self, message: Twist) -> None:
        self._commanded.append(message)
        self._woken.set()

    def _take_scan(self, message: LaserScan) -> None:
        self._scans.append(dated(message))
        self._woken.set()

    def _take_footprint(self, message: Polygon) -> None:
        try:
            self._outlines.append(padded(outline_from_message(message), self._settings.footprint_padding))
            self._woken.set()
        except ValueError as error:
            rospy.logerr_throttle(WARN_PERIOD, f"footprint refused: {one_line(error)}")

    def _step(self, now: float) -> None:
        """Process scans and the newest velocity; publish the verdict if there is a new velocity or it has changed."""
        self._clock.note(now)
        self._guard.time_stands = self._clock.stands
        scans: Dict[str, LaserScan] = {}
        while self._scans:
            scan = self._scans.popleft()
            scans[scan.header.frame_id] = scan
        command = self._commanded.pop() if self._commanded else None
        for scan in scans.values():
            placed = self._lidars.place(scan, now)
            if placed is not None:
                self._guard.take_scan(*placed)
        if scans:
            self._lidars.follow(now)
        if command is not None:
            asked = Twist2D(command.linear.x, command.linear.y, command.angular.z)
            self._guard.take_command(now, self._steering.turning(asked) if self._steering else asked, self._motion(now))
        elif self._commands.get_num_connections() == 0:
            self._guard.forget_command()
        before, self._verdict = self._verdict, self._guard.verdict(now)
        if command is not None:
            self._counts[self._verdict.cause] = self._counts.get(self._verdict.cause, 0) + 1
        if command is not None or self._verdict.velocity != before.velocity:
            self._send(self._verdict.velocity)
        unheard = self._unheard()
        if unheard:
            rospy.logwarn_throttle(WARN_PERIOD, f"passing velocities {unheard}")
        if (self._verdict.cause, self._verdict.velocity == STOP) != (before.cause, before.velocity == STOP):
            self._tell(now)

    def _motion(self, now: float) -> Optional[Twist2D]:
        """Return odometry's velocity, None where it is missing or too old; the guard works without it, too."""
        try:
            return self._odometry.read(now, MOTION_AGE)[2]
        except StaleDataError:
            return None

    def _unheard(self) -> str:
        """Return a text if velocities pass but `cmd_vel` has no subscriber; empty otherwise."""
        if self._verdict.velocity == STOP or self._velocity.get_num_connections():
            return ""
        return f"to nobody: no reachable node subscribes to {self._velocity.resolved_name}"

    def _unasked(self) -> str:
        """Return a text if `cmd_vel_raw` has no publisher; empty otherwise."""
        if self._commands.get_num_connections():
            return ""
        return (f"nobody publishes on {self._commands.resolved_name}: who drives the robot does so past this guard, or "
                "not at all")

    def _lacking(self, now: float) -> str:
        """Return what is missing around the guard: subscriber, publisher or transforms; empty for nothing."""
        return self._unheard() or self._unasked() or self._lidars.without(now)

    def _send(self, velocity: Twist2D) -> None:
        with self._sending:
            if not self._closed:
                told = self._steering.steered(velocity) if self._steering else velocity
                self._velocity.publish(twist_to_message(told))

    def _tell(self, now: float) -> None:
        """Publish and log what the guard does and why, when that changes."""
        text = self._text(now)
        self._state.publish(text)
        if self._verdict.cause not in (PASSING, STANDING):
            rospy.loginfo_throttle(2.0, text)

    def _text(self, now: float) -> str:
        trouble = self._lidars.trouble if self._verdict.cause == NO_SCAN else self._lacking(now)
        return f"{self._verdict.text} ({trouble})" if trouble else self._verdict.text

    def _report(self) -> diagnostics.Report:
        values: Dict[str, object] = {
            f"velocities, {cause}": count for cause, count in sorted(dict(self._counts).items())}
        values["velocities take effect after [s]"] = f"{self._guard.delay.seconds:.2f}"
        now = rospy.get_time()
        unasked = self._unasked()
        if not unasked:
            self._alone_since = time.monotonic()
        elif time.monotonic() - self._alone_since > ALONE_FOR:
            rospy.logwarn_once(unasked)
        fine = self._verdict.cause in (PASSING, STANDING) and not self._lacking(now)
        return diagnostics.OK if fine else diagnostics.WARN, self._text(now), values


def main() -> None:
    """Run the node until ROS is shut down."""
    node = VelocityGuardNode(parameters.load(VelocityGuardParameters))
    rospy.loginfo("velocity_guard is ready")
    spare_what_stays()
    node.run()
