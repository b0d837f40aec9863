#!/usr/bin/env python3
"""Waypoints one after the other, by the action and by follow_waypoints' topics, before a move_base of paper."""

import os
import subprocess
import sys
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseArray, PoseStamped, PoseWithCovarianceStamped
from move_base_msgs.msg import MoveBaseAction
from ros_testing import Listener, connected_publisher, wait_until
from rosgraph_msgs.msg import Log
from std_msgs.msg import Empty

from mbf_relay.msg import FollowWaypointsAction, FollowWaypointsActionFeedback, FollowWaypointsGoal
from mbf_relay.ros.common.actions.action_client import ActionClient
from mbf_relay.ros.common.actions.action_server import ActionServer

WALL, SLOW, NONSENSE = -1.0, -2.0, -3.0
"""Places (x, m) that this move_base never reaches, that it is on its way to until it is told otherwise, and that it
refuses, on its way to the place before: a real one would, where a pose is not finite."""


class PaperMoveBase:
    """Reaches what it is told at once, but for WALL and SLOW; a new goal ends the old one."""

    def __init__(self):
        self.goals, self.running = [], None
        self.server = ActionServer("move_base", MoveBaseAction, self.take, self.cancel)
        self.server.start()

    def take(self, goal):
        x = goal.get_goal().target_pose.pose.position.x
        self.goals.append(x)
        goal.set_accepted()
        if x == NONSENSE:
            goal.set_aborted(text="not finite")
            return
        self.drop()
        if x == WALL:
            goal.set_aborted(text="a wall")
        elif x == SLOW:
            self.running = goal
        else:
            goal.set_succeeded()

    def cancel(self, goal):
        if self.running is not None and goal.get_goal_id().id == self.running.get_goal_id().id:
            self.drop()

    def drop(self):
        goal, self.running = self.running, None
        if goal is not None:
            goal.set_canceled()


def goal_of(*places, **more):
    poses = []
    for x in places:
        pose = PoseStamped()
        pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w = "map", x, 1.0
        poses.append(pose)
    return FollowWaypointsGoal(poses=poses, **more)


class WaypointFollowerTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("waypoint_follower_test")
        cls.move_base = PaperMoveBase()
        cls.client = ActionClient("follow_waypoints", FollowWaypointsAction)
        wait_until(lambda: cls.client.wait_for_server(0.1), "the action follow_waypoints", 60.0)
        cls.feedback = Listener("follow_waypoints/feedback", FollowWaypointsActionFeedback, connected=True)
        cls.shown = Listener("waypoints", PoseArray, connected=True)
        cls.poses = connected_publisher("addpose", PoseWithCovarianceStamped, queue_size=1000)

    def setUp(self):
        self.move_base.goals.clear()

    def end_of(self, sent):
        return wait_until(lambda: (self.client.check(), sent.ending)[1], "the goal's end", 30.0)

    def follow(self, *places, **more):
        return self.end_of(self.client.send(goal_of(*places, **more)))

    def forget_waypoints(self):
        """Reset the path and wait until that has had its effect, or it would cancel the next test's goal."""
        sent = self.client.send(goal_of(SLOW))
        self.wait_on_the_way()
        connected_publisher("path_reset", Empty).publish(Empty())
        self.end_of(sent)
        wait_until(lambda: self.move_base.running is None, "the drive's end after path_reset")

    def wait_on_the_way(self):
        wait_until(lambda: self.move_base.running, "the goal at move_base", 30.0)

    def test_all_are_reached_in_order_and_told(self):
        ending = self.follow(1.0, 2.0, 3.0, number_of_loops=1)
        self.assertEqual((ending.status, list(ending.result.missed_waypoints)), (GoalStatus.SUCCEEDED, []))
        self.assertEqual(self.move_base.goals, [1.0, 2.0, 3.0] * 2)
        expected = [(loop, index) for loop in (0, 1) for index in (0, 1, 2)]

        def told():
            return [(m.feedback.current_loop, m.feedback.current_waypoint) for m in self.feedback.messages]

        wait_until(lambda: told()[-6:] == expected, lambda: f"{expected} in the feedback, which told {told()}")

    def test_one_that_is_not_reached_is_left_out_or_ends_it(self):
        ending = self.follow(1.0, WALL, 3.0)
        self.assertEqual((ending.status, list(ending.result.missed_waypoints)), (GoalStatus.SUCCEEDED, [1]))
        self.assertEqual(self.move_base.goals, [1.0, WALL, 3.0])
        ending = self.follow(1.0, WALL, 3.0, stop_on_failure=True)
        self.assertEqual((ending.status, list(ending.result.missed_waypoints)), (GoalStatus.ABORTED, [1]))
        self.assertEqual(self.move_base.goals[3:], [1.0, WALL])
        self.assertEqual(ending.text, "waypoint 1 was not reached: a wall")

    def test_nonsense_is_rejected_with_its_value(self):
        self.assertEqual(self.follow().status, GoalStatus.REJECTED)
        ending = self.follow(1.0, goal_index=7)
        self.assertEqual(ending.status, GoalStatus.REJECTED)
        self.assertIn("goal_index is 7", ending.text)
        self.assertEqual(self.move_base.goals, [])

    def test_a_cancel_ends_the_drive_to_the_waypoint_too(self):
        sent = self.client.send(goal_of(1.0, SLOW, 3.0))
        self.wait_on_the_way()
        sent.cancel()
        self.assertEqual(self.end_of(sent).status, GoalStatus.PREEMPTED)
        self.assertIsNone(self.move_base.running)
        self.assertEqual(self.move_base.goals, [1.0, SLOW])

    def test_a_newer_goal_takes_the_place_of_the_older_one(self):
        older = self.client.send(goal_of(SLOW, 2.0))
        self.wait_on_the_way()
        self.assertEqual(self.follow(5.0).status, GoalStatus.SUCCEEDED)
        self.assertEqual(self.end_of(older).status, GoalStatus.PREEMPTED)
        self.assertEqual(self.move_base.goals, [SLOW, 5.0])

    def test_a_robot_stands_where_move_base_refuses_the_goal_that_takes_the_place_of_another(self):
        older = self.client.send(goal_of(SLOW))
        self.wait_on_the_way()
        ending = self.follow(NONSENSE, stop_on_failure=True)
        self.assertEqual((ending.status, list(ending.result.missed_waypoints)), (GoalStatus.ABORTED, [0]))
        self.assertEqual(self.end_of(older).status, GoalStatus.PREEMPTED)
        wait_until(lambda: self.move_base.running is None, "move_base to be told to stand")

    def test_whoever_sends_the_robot_elsewhere_meanwhile_has_it(self):
        sent = self.client.send(goal_of(SLOW, 2.0))
        self.wait_on_the_way()
        subprocess.run(
            ["rostopic", "pub", "-1", "move_base/cancel", "actionlib_msgs/GoalID", "{}"], check=True, timeout=30.0,
            stdout=subprocess.DEVNULL)
        ending = self.end_of(sent)
        self.assertEqual((ending.status, list(ending.result.missed_waypoints)), (GoalStatus.ABORTED, [0]))
        self.assertIn("another goal", ending.text)
        self.assertEqual(self.move_base.goals, [SLOW])

    def test_poses_gathered_by_topic_are_shown_and_followed_when_the_path_is_ready(self):
        ready, reset = connected_publisher("path_ready", Empty), connected_publisher("path_reset", Empty)
        said = []
        log = rospy.Subscriber("/rosout", Log, lambda m: said.append(m.msg))
        wait_until(lambda: "/waypoint_follower" in [link.callerid_pub for link in log.impl.connections], "its log")
        ready.publish(Empty())  # without any: nothing to do
        wait_until(lambda: any("there are no waypoints" in text for text in said), "word of no waypoints")
        log.unregister()
        since = len(self.shown.messages)
        for number, x in enumerate((1.0, SLOW), 1):
            pose = PoseWithCovarianceStamped()
            pose.header.frame_id, pose.pose.pose.position.x = "map", x
            self.poses.publish(pose)
            self.shown.wait_for(lambda m, n=number: len(m.poses) == n, f"{number} waypoints", since=since)
        self.assertEqual(self.move_base.goals, [])
        ready.publish(Empty())
        self.wait_on_the_way()
        since = len(self.shown.messages)
        reset.publish(Empty())
        wait_until(lambda: self.move_base.running is None, "the drive's end after path_reset")
        self.shown.wait_for(lambda m: not m.poses, "no waypoints any more", since=since)
        self.assertEqual(self.move_base.goals, [1.0, SLOW])

    def test_of_poses_that_a_program_sends_at_once_none_is_left_out(self):
        """Of sixty 38 were taken, the last ones: the robot skipped a third of its round, and nothing said so."""
        self.addCleanup(self.forget_waypoints)
        since = len(self.shown.messages)
        for x in range(500):
            pose = PoseWithCovarianceStamped()
            pose.header.frame_id, pose.pose.pose.position.x = "map", x
            self.poses.publish(pose)
        shown = self.shown.wait_for(lambda m: m.poses and m.poses[-1].position.x == 499, "the last pose", since=since)
        self.assertEqual([pose.position.x for pose in shown.poses], list(range(500)))


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "waypoint_follower_test", WaypointFollowerTest)
