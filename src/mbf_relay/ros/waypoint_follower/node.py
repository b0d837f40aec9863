"""The waypoint_follower node: sends poses to move_base as goals, one after the other.

Poses come as goals of the action `follow_waypoints`, or one by one on `addpose_topic` until `path_ready`; `path_reset`
forgets them and ends the drive. `waypoints` shows them. move_base drives to each; if another client sends it a goal
meanwhile, the drive to the waypoints ends and that goal goes on.
"""

from __future__ import annotations

import time
from typing import Any, List, Optional

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from std_msgs.msg import Empty

from mbf_relay.navigation.waypoints import WaypointFollower, WaypointFollowerParameters
from mbf_relay.ros.common import parameters as ros_parameters
from mbf_relay.ros.common.actions.action_client import ActionClient
from mbf_relay.ros.common.actions.action_server import ActionServer
from mbf_relay.ros.common.actions.client_goals import ActionEnding, SentGoal
from mbf_relay.ros.common.actions.server_watch import check_alone
from mbf_relay.ros.common.node import on_shutdown

LOOK_PERIOD = 0.05
"""Wall time (s) between two checks of move_base's goal."""
NOT_OURS = (GoalStatus.PREEMPTED, GoalStatus.RECALLED, GoalStatus.LOST)
"""States of a goal at move_base that another client has replaced or cancelled, or that was lost with its server."""


class WaypointFollowerNode:
    """Carries out one goal of the action at a time; a newer one replaces it.

    The action server's lock guards all fields.
    """

    def __init__(self, parameters: WaypointFollowerParameters) -> None:
        from mbf_relay.msg import FollowWaypointsAction, FollowWaypointsFeedback, FollowWaypointsResult

        check_alone("follow_waypoints")
        self._feedback, self._result = FollowWaypointsFeedback, FollowWaypointsResult
        self._client = ActionClient("move_base", MoveBaseAction, leased=True)
        self._goal: Optional[Any] = None
        self._follower = WaypointFollower(1)
        self._sent: Optional[SentGoal] = None
        self._left: List[SentGoal] = []  # goals at move_base that belong to replaced goals of this action
        self._cancelled, self._why = False, ""  # why the last waypoint was not reached
        self._server = ActionServer(
            "follow_waypoints", FollowWaypointsAction, self._take, self._take_cancel, overtaken_cb=self._take_overtaken)
        self._lock = self._server.lock
        on_shutdown(self._close)
        self._topics = WaypointTopics(parameters)
        self._server.start()
        check_alone("follow_waypoints")

    def update(self, now: float) -> None:
        """Take the end of a drive and send the next waypoint; call every LOOK_PERIOD.

        Args:
            now: ROS time (s).
        """
        self._client.check()
        with self._lock:
            if self._goal is None:
                return
            if self._sent is not None:
                if self._sent.ending is None:
                    return
                ending, self._sent = self._sent.ending, None
                self._call_off_left()
                self._take_ending(now, ending)
            if self._goal is not None:
                self._go_on(now)

    def _take_ending(self, now: float, ending: ActionEnding) -> None:
        """Record how the drive to a waypoint ended; abort where another client has taken over the robot."""
        follower = self._follower
        reached = ending.status == GoalStatus.SUCCEEDED
        if ending.status in NOT_OURS and not self._cancelled:
            lost = ending.status == GoalStatus.LOST
            reason = ending.text if lost else "move_base was given another goal, or called off"
            follower.missed.append(follower.current)
            self._end("aborted", f"on the way to waypoint {follower.current}: {reason}")
            return
        follower.ended(now, reached)
        self._why = ending.text
        if not reached and not self._cancelled:
            rospy.logwarn("waypoint %d was not reached: %s", follower.current, ending.text)

    def _go_on(self, now: float) -> None:
        """Send the next waypoint when it is time, or end the goal."""
        follower, goal = self._follower, self._goal
        assert goal is not None
        if self._cancelled:
            self._end("canceled", f"called off on the way to waypoint {follower.current}")
        elif follower.has_failed:
            self._end("aborted", f"waypoint {follower.current} was not reached: {self._why}")
        elif follower.is_over:
            self._end("succeeded", f"{len(follower.missed)} of the waypoints were missed" if follower.missed else "")
        else:
            index = follower.next_waypoint(now)
            if index is not None:
                goal.publish_feedback(self._feedback(index, follower.loop))
                self._sent = self._client.send(MoveBaseGoal(goal.get_goal().poses[index]))

    def _take(self, goal: Any) -> None:
        wanted = goal.get_goal()
        try:
            follower = WaypointFollower(
                len(wanted.poses), wanted.number_of_loops, wanted.goal_index, wanted.waypoint_pause_duration,
                wanted.stop_on_failure)
        except ValueError as error:
            goal.set_rejected(self._result(), str(error))
            return
        self._end("canceled", "another goal has come")
        if self._sent is not None:  # the robot drives on for it until move_base gets the next one
            self._left.append(self._sent)
        goal.set_accepted()
        self._goal, self._follower, self._sent, self._cancelled = goal, follower, None, False
        self._topics.show(wanted.poses)

    def _take_cancel(self, goal: Any) -> None:
        if self._goal is not None and goal.get_goal_id().id == self._goal.get_goal_id().id:
            self._cancelled = True
            if self._sent is not None:
                self._sent.cancel()
            self._call_off_left()

    def _take_overtaken(self, _goal: Any) -> None:
        """Stop for a newer goal whose cancel came before it: it would have replaced this goal and been cancelled."""
        self._end("canceled", "another goal has come")
        if self._sent is not None:
            self._sent.cancel()
        self._call_off_left()

    def _call_off_left(self) -> None:
        """Cancel goals of replaced ones that move_base may still carry out, as where it refused the next one."""
        left, self._left = self._left, []
        for sent in left:
            sent.cancel()

    def _end(self, how: str, text: str) -> None:
        goal, self._goal = self._goal, None
        if goal is not None:
            rospy.loginfo("waypoints %s%s", how, f": {text}" if text else "")
            getattr(goal, f"set_{how}")(self._result(self._follower.missed), text)
            self._topics.show([])

    def _close(self) -> None:
        with self._lock:
            self._client.cancel_all()
            self._end("aborted", "waypoint_follower is shutting down")


class WaypointTopics:
    """Topics of the package follow_waypoints: poses collected one by one are sent as a goal of the action."""

    def __init__(self, parameters: WaypointFollowerParameters) -> None:
        from mbf_relay.msg import FollowWaypointsActionGoal

        self._parameters, self._action_goal = parameters, FollowWaypointsActionGoal
        self._gathered: List[PoseStamped] = []
        self._shown = rospy.Publisher("waypoints", PoseArray, queue_size=1, latch=True)
        self._goals = rospy.Publisher("follow_waypoints/goal", FollowWaypointsActionGoal, queue_size=1)
        self._cancels = rospy.Publisher("follow_waypoints/cancel", GoalID, queue_size=1)
        self.show([])
        # no queue_size, or rospy would drop all but the last of poses that a program sends at once
        rospy.Subscriber(parameters.addpose_topic, PoseWithCovarianceStamped, self._add)
        rospy.Subscriber("path_ready", Empty, self._start, queue_size=1)
        rospy.Subscriber("path_reset", Empty, self._reset, queue_size=1)

    def show(self, poses: List[PoseStamped]) -> None:
        """Publish `poses`, the waypoints of the running goal; if empty, those collected for the next one."""
        poses = poses or self._gathered
        shown = PoseArray(poses=[pose.pose for pose in poses])
        shown.header.stamp = rospy.get_rostime()
        shown.header.frame_id = poses[0].header.frame_id if poses else self._parameters.goal_frame_id
        self._shown.publish(shown)

    def _add(self, message: PoseWithCovarianceStamped) -> None:
        pose = PoseStamped(pose=message.pose.pose)
        pose.header.frame_id = message.header.frame_id or self._parameters.goal_frame_id
        self._gathered.append(pose)
        rospy.loginfo("waypoint %d added; path_ready starts the drive, path_reset removes all", len(self._gathered))
        self.show([])

    def _start(self, _message: Empty) -> None:
        goal, parameters = self._action_goal(), self._parameters
        goal.header.stamp = rospy.get_rostime()
        goal.goal.poses, self._gathered = self._gathered, []
        goal.goal.waypoint_pause_duration = parameters.wait_duration
        goal.goal.number_of_loops, goal.goal.stop_on_failure = parameters.number_of_loops, parameters.stop_on_failure
        if goal.goal.poses:
            self._goals.publish(goal)
        else:
            rospy.logwarn("path_ready was received, but there are no waypoints; add them on %s",
                          rospy.resolve_name(parameters.addpose_topic))

    def _reset(self, _message: Empty) -> None:
        self._gathered = []
        self._cancels.publish(GoalID())
        self.show([])


def main() -> None:
    """Follow waypoints until the node ends."""
    node = WaypointFollowerNode(ros_parameters.load(WaypointFollowerParameters))
    rospy.loginfo("waypoint_follower is ready")
    while not rospy.is_shutdown():
        node.update(rospy.get_time())
        time.sleep(LOOK_PERIOD)
