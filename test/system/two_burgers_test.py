#!/usr/bin/env python3
"""Two burgers in one graph and one arena: each drives to its own goal, sees the other, and touches nothing."""

import os
import sys
import unittest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Twist
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import Odometry
from ros_testing import Listener, wait_until
from running_stack import start_test_node
from visualization_msgs.msg import MarkerArray

from mbf_relay.ros.common.actions.action_client import ActionClient
from mbf_relay.ros.common.conversions import pose_from_message

GOALS = {"burger1": (-0.45, -0.55, 1.0), "burger2": (0.45, -0.55, 0.0)}
"""x, y (m) and the w of the heading, towards each other: they meet in the middle and stop apart."""
PATIENCE = 120.0


class TwoBurgersTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.truth = {name: Listener(f"{name}/ground_truth", Odometry, connected=True) for name in GOALS}
        cls.contacts = {name: Listener(f"{name}/contacts", MarkerArray) for name in GOALS}
        cls.obstacles = {name: Listener(f"{name}/simulator/obstacles", MarkerArray) for name in GOALS}
        cls.velocities = {name: Listener(f"{name}/cmd_vel", Twist) for name in GOALS}
        cls.clients = {name: ActionClient(f"{name}/move_base", MoveBaseAction) for name in GOALS}
        for name, client in cls.clients.items():
            assert client.wait_for_server(60.0), f"waited 60 s for move_base of {name}, in vain"

    def pose(self, name):
        return pose_from_message(self.truth[name].last.pose.pose)

    def sees(self, name, other):
        seen = [marker for marker in self.obstacles[name].last.markers if marker.ns.strip("/") == other]
        return len(seen) == 1 and self.pose(other).distance_to(pose_from_message(seen[0].pose)) < 0.1

    def test_both_get_where_they_are_sent(self):
        sent = {}
        for name, (x, y, w) in GOALS.items():
            goal = MoveBaseGoal()
            goal.target_pose.header.frame_id = "map"
            goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = x, y
            goal.target_pose.pose.orientation.w = w
            goal.target_pose.pose.orientation.z = 1.0 - w
            sent[name] = self.clients[name].send(goal)
        for name, (x, y, _w) in GOALS.items():
            ending = sent[name].wait(PATIENCE)
            self.assertIsNotNone(ending, f"waited {PATIENCE} s for {name}, in vain")
            self.assertEqual(ending.status, GoalStatus.SUCCEEDED, f"{name}: {ending.text}")
            pose = self.pose(name)
            self.assertLess(abs(pose.x - x) + abs(pose.y - y), 0.25, f"{name} stands at {tuple(pose)}")
        for name, other in (("burger1", "burger2"), ("burger2", "burger1")):
            self.assertFalse([marker.ns for message in self.contacts[name].messages for marker in message.markers])
            wait_until(lambda: self.sees(name, other), f"{name} to see {other}, once and where it is")
            wait_until(lambda: self.velocities[name].last.linear.x == 0.0, f"a zero as the last velocity of {name}")

    def test_stamps_of_both_keep_to_one_clock(self):
        for name, truth in self.truth.items():
            before = truth.last.header.stamp.to_sec()

            def is_of_now(truth=truth, before=before):  # the clock comes another way, on a busy machine sooner or later
                stamp = truth.last.header.stamp.to_sec()
                return stamp > before and abs(stamp - rospy.get_time()) < 1.0

            wait_until(is_of_now, f"newer odometry of {name}, by the clock that all go by")


if __name__ == "__main__":
    start_test_node("two_burgers_test")
    rostest.rosrun("mbf_relay", "two_burgers", TwoBurgersTest)
