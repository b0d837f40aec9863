"""~pause and ~resume: stop the robot without ending its goal, and go on; ~paused tells which."""

from __future__ import annotations

from typing import Callable

import rospy
from std_msgs.msg import Bool
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from mbf_relay.navigation.robot import Robot


class PauseServices:
    """Offers both services. While paused, goals stay active, timeouts do not run, and the robot gets no velocities."""

    def __init__(self, robot: Robot, wake: Callable[[], None]) -> None:
        """Advertise.

        Args:
            robot: The robot whose drives and recoveries pause.
            wake: Wakes the stepping thread.
        """
        self._robot, self._wake = robot, wake
        self._told = rospy.Publisher("~paused", Bool, queue_size=1, latch=True)
        self._told.publish(Bool(False))
        rospy.Service("~pause", Trigger, lambda request: self._answer(request, True))
        rospy.Service("~resume", Trigger, lambda request: self._answer(request, False))

    def _answer(self, _request: TriggerRequest, paused: bool) -> TriggerResponse:
        if self._robot.paused == paused:
            return TriggerResponse(True, "it is paused already" if paused else "it is not paused")
        self._robot.paused = paused
        self._wake()
        self._told.publish(Bool(paused))
        rospy.loginfo("paused: goals stay active and the robot stands until ~resume" if paused else "resumed")
        return TriggerResponse(True, "paused" if paused else "resumed")
