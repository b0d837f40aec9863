"""What the server tells of its work beside the actions: the goals in pursuit."""

from __future__ import annotations

import rospy
from geometry_msgs.msg import PoseStamped

from mbf_relay.navigation.navigator import Navigator
from mbf_relay.ros.conversions import pose_stamped


class NavigationTopics:
    """Publishes `~planner_goal` and `~controller_goal`, and both also as `~current_goal`, which mbf_msgs 0.4.0 has.

    Args:
        navigator: Whose work it tells of.
    """

    def __init__(self, navigator: Navigator) -> None:
        self._navigator = navigator
        self._goals = {
            kind: rospy.Publisher(f"~{kind}_goal", PoseStamped, queue_size=1) for kind in ("planner", "controller")
        }
        self._current_goal = rospy.Publisher("~current_goal", PoseStamped, queue_size=1)

    def publish(self, now: float) -> None:
        """Publish what happened since the last call; `now` in seconds."""
        for kind, goal in self._navigator.take_announced():
            message = pose_stamped(goal.pose, goal.frame, now)
            self._goals[kind].publish(message)
            self._current_goal.publish(message)
