#!/usr/bin/env python3
"""Nodes that are killed or frozen while the robot drives: it stands, and its client is told why."""

import atexit
import os
import signal
import subprocess
import sys
import unittest

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist
from mbf_msgs.msg import MoveBaseAction as FlexAction
from mbf_msgs.msg import MoveBaseActionResult
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import Odometry

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from running_stack import Witness, start_test_node  # noqa: E402

from mbf_relay.benchmarks.processes import node_pid  # noqa: E402
from mbf_relay.ros.action_client import ActionClient  # noqa: E402
from mbf_relay.simulation.arena import CIRCLE  # noqa: E402
from ros_testing import Listener, wait_until  # noqa: E402

SLOW = 0.01
"""Metres and radians per second below which a robot counts as standing."""


def goal_at(place):
    x, y, z, w = place
    pose = PoseStamped(pose=Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, z, w)))
    pose.header.frame_id = "map"
    return MoveBaseGoal(pose)


class TestPulledNodes(unittest.TestCase):
    """Run in the order of their names: what is pulled stays away, but for the server."""

    @classmethod
    def setUpClass(cls):
        cls.witness = Witness()
        cls.truth = Listener("ground_truth", Odometry, connected=True)
        cls.outcomes = Listener("move_base/navigation_outcome", MoveBaseActionResult, connected=True)
        cls.client = ActionClient("move_base", MoveBaseAction)
        cls.flex = ActionClient("move_base_flex/move_base", FlexAction)
        cls.commands = Listener("cmd_vel", Twist, connected=True)

    def setUp(self):
        for client in (self.client, self.flex):
            self.assertTrue(client.wait_for_server(60.0), f"waited 60 s for {client.name}, in vain")

    def speed(self):
        twist = self.truth.last.twist.twist
        return max(abs(twist.linear.x), abs(twist.angular.z))

    def drive(self, place):
        """Send a goal and wait until the robot drives straight on."""
        sent = self.client.send(goal_at(place))
        wait_until(lambda: self.truth.last.twist.twist.linear.x > 0.1 or sent.ending, "the robot to drive")
        self.assertIsNone(sent.ending)
        return sent

    def check_stop(self, sent, words):
        """Expect the goal to be aborted for a reason that matches the words, and the robot to stand."""
        ending = sent.wait(60.0)
        self.assertIsNotNone(ending, "waited 60 s for the end of the goal, in vain")
        self.assertEqual(ending.status, GoalStatus.ABORTED)
        outcome = self.outcomes.wait_for(lambda m: m.status.goal_id.id == sent.goal_id, "the goal's outcome")
        self.assertRegex(outcome.result.message, words)
        wait_until(lambda: self.commands.last == Twist(), "a zero as the last velocity")
        wait_until(lambda: self.speed() < SLOW, "the robot to stand")

    def check_relay_stopped_it(self):
        self.assertEqual(self.commands.last._connection_header["callerid"], "/move_base")

    def test_1_a_frozen_server(self):
        server = node_pid("/move_base_flex", rospy.get_name())
        sent = self.drive(CIRCLE[0])
        os.kill(server, signal.SIGSTOP)
        try:
            self.check_stop(sent, r"/move_base_flex has been silent for \d+\.\d s")
            self.check_relay_stopped_it()
        finally:
            os.kill(server, signal.SIGCONT)

    def test_2_a_killed_server(self):
        sent = self.drive(CIRCLE[0])
        os.kill(node_pid("/move_base_flex", rospy.get_name()), signal.SIGKILL)
        self.check_stop(sent, "/move_base_flex/move_base died")
        self.check_relay_stopped_it()
        again = subprocess.Popen(["rosrun", "mbf_relay", "move_base_flex"])
        atexit.register(again.kill)

    def test_3_a_map_once_given_needs_no_map_server(self):
        sent = self.drive(CIRCLE[0])
        os.kill(node_pid("/map_server", rospy.get_name()), signal.SIGKILL)
        ending = sent.wait(120.0)
        self.assertIsNotNone(ending, "waited 120 s for the goal, in vain")
        self.assertEqual(ending.status, GoalStatus.SUCCEEDED, ending.text)

    def test_4_a_killed_localization(self):
        sent = self.drive(CIRCLE[-1])
        os.kill(node_pid("/amcl", rospy.get_name()), signal.SIGKILL)
        self.check_stop(sent, r"transform from 'map' to 'odom' is \d+\.\d\d s old")


if __name__ == "__main__":
    start_test_node("pulled_nodes_test")
    rostest.rosrun("mbf_relay", "pulled_nodes", TestPulledNodes)
