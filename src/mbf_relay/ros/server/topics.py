"""The server's topics beside its actions: the current goals, and the recoveries that begin."""

from __future__ import annotations

from typing import Optional

import rospy
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import RecoveryStatus

from mbf_relay.navigation.goals import FramedPose
from mbf_relay.navigation.navigator import Navigator
from mbf_relay.ros.common.conversions import pose_stamped


class NavigationTopics:
    """Publishes `~planner_goal` and `~controller_goal`, and both also on `~current_goal`, as Move Base Flex 0.4.0 does.

    `~recovery_status` has each recovery that move_base begins, as of the node move_base; it is logged too, and so is
    one that fails.

    Args:
        navigator: Its goals and recoveries are published.
        is_move_base: Whether this is a node move_base: its `~current_goal` is the relay's, and recovery_status stands
            beside the action, whatever the node is called.
    """

    def __init__(self, navigator: Navigator, is_move_base: bool) -> None:
        self._navigator = navigator
        self._goals = {
            kind: rospy.Publisher(f"~{kind}_goal", PoseStamped, queue_size=1) for kind in ("planner", "controller")
        }
        self._current_goal = rospy.Publisher("~current_goal", PoseStamped, queue_size=1) if not is_move_base else None
        namespace = f"{rospy.resolve_name('move_base')}/" if is_move_base else "~"
        self._recovery_status = rospy.Publisher(f"{namespace}recovery_status", RecoveryStatus, queue_size=10)
        navigator.recovery_watcher = self._tell_recovery
        navigator.failure_watcher = lambda text: rospy.logwarn("%s", text)

    def publish(self, now: float) -> None:
        """Publish what happened since the last call; `now` in seconds."""
        for kind, goal in self._navigator.take_announced():
            message = pose_stamped(goal.pose, goal.frame, now)
            self._goals[kind].publish(message)
            if self._current_goal is not None:
                self._current_goal.publish(message)

    def _tell_recovery(self, name: str, number: int, total: int, robot: Optional[FramedPose], why: str) -> None:
        pose = PoseStamped() if robot is None else pose_stamped(robot.pose, robot.frame, rospy.get_rostime())
        where = "an unknown place" if robot is None else "x {:.2f}, y {:.2f}, yaw {:.2f}".format(*robot.pose)
        rospy.logwarn("recovering by '%s' (%d of %d) at %s after %s", name, number + 1, total, where, why)
        self._recovery_status.publish(RecoveryStatus(pose, number, total, name))
