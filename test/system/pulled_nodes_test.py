#!/usr/bin/env python3
"""Nodes that are killed or frozen while the robot drives: it stands, its client is told why, and the next goal works.
"""

import os
import random
import signal
import sys
import unittest

import rosgraph
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist
from mbf_msgs.msg import MoveBaseAction as FlexAction
from mbf_msgs.msg import MoveBaseActionResult
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import Odometry

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from benchmark.processes import node_pid  # noqa: E402
from ros_testing import Listener, wait_until  # noqa: E402
from running_stack import Witness, start_test_node  # noqa: E402

from mbf_relay.outcomes import TransformError  # noqa: E402
from mbf_relay.ros.common.action_client import ActionClient  # noqa: E402
from mbf_relay.ros.common.transforms import Transforms  # noqa: E402
from mbf_relay.simulation.arena import CIRCLE  # noqa: E402

NODES = ("/move_base_flex", "/velocity_guard", "/move_base", "/amcl", "/map_server", "/robot_state_publisher")
ON_THE_WAY_TO_THE_WHEELS = NODES[:2]

LOST = r"transform from 'map' to 'odom' is \d+\.\d\d s old"
"""What ends a drive without localization."""
SLOW = 0.01
"""Metres and radians per second below which a robot counts as standing."""


def goal_at(place):
    x, y, z, w = place
    pose = PoseStamped(pose=Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, z, w)))
    pose.header.frame_id = "map"
    return MoveBaseGoal(pose)


class TestPulledNodes(unittest.TestCase):
    """Run in the order of their names. roslaunch starts again what was killed."""

    @classmethod
    def setUpClass(cls):
        cls.witness = Witness()
        cls.truth = Listener("ground_truth", Odometry, connected=True)
        cls.outcomes = Listener("move_base/navigation_outcome", MoveBaseActionResult, connected=True)
        cls.client = ActionClient("move_base", MoveBaseAction)
        cls.flex = ActionClient("move_base_flex/move_base", FlexAction)
        cls.commands = Listener("cmd_vel", Twist, connected=True)
        cls.transforms = Transforms()

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
        senders = {m._connection_header["callerid"] for m in self.commands.messages[-20:] if m == Twist()}
        self.assertIn("/move_base", senders)

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

    def test_3_a_map_once_given_needs_no_map_server(self):
        sent = self.drive(CIRCLE[0])
        os.kill(node_pid("/map_server", rospy.get_name()), signal.SIGKILL)
        ending = sent.wait(120.0)
        self.assertIsNotNone(ending, "waited 120 s for the goal, in vain")
        self.assertEqual(ending.status, GoalStatus.SUCCEEDED, ending.text)

    def test_5_a_killed_localization(self):
        sent = self.drive(CIRCLE[-1])
        os.kill(node_pid("/amcl", rospy.get_name()), signal.SIGKILL)
        self.check_stop(sent, LOST)
        self.check_next_goal(CIRCLE[0], "localization was killed")

    def test_6_a_frozen_localization(self):
        amcl = node_pid("/amcl", rospy.get_name())
        sent = self.drive(CIRCLE[-1])
        os.kill(amcl, signal.SIGSTOP)
        try:
            self.check_stop(sent, LOST)
        finally:
            os.kill(amcl, signal.SIGCONT)
        self.check_next_goal(CIRCLE[0], "localization was frozen")

    def check_next_goal(self, place, what):
        """Expect the next goal to be reached, once everything is back, and nothing to have been touched."""
        self.wait_until_all_is_back()
        ending = self.client.send(goal_at(place)).wait(120.0)
        self.assertIsNotNone(ending, f"waited 120 s for the goal after {what}, in vain")
        self.assertEqual(ending.status, GoalStatus.SUCCEEDED, f"after {what}: {ending.text}")
        self.assertEqual(self.witness.touched(), [])

    def test_4_any_node_killed_or_frozen_at_any_moment(self):
        """What is pulled is back without a hand: the robot does not run on without it, and the next goal is reached."""
        chance = random.Random(7)
        for trial in range(100 if os.environ.get("MBF_RELAY_LONG") else 4):
            node = NODES[trial % len(NODES)]
            number = chance.choice((signal.SIGKILL, signal.SIGSTOP))
            place = CIRCLE[trial % len(CIRCLE)]
            self.pull(node, number, place, drives=chance.random() < 0.7, moment=chance.uniform(0.0, 0.1))
            self.check_next_goal(place, f"{node} got signal {int(number)} in trial {trial}")

    def pull(self, node, number, place, drives, moment):
        """Kill or freeze a node, see what the robot does, and let a frozen one go on.

        Args:
            node: Its name.
            number: The signal.
            place: Where to drive meanwhile.
            drives: Whether the robot drives at all.
            moment: Metres to drive before.
        """
        pid = node_pid(node, rospy.get_name())
        sent = self.drive(place) if drives else None
        start = self.witness.pose
        if sent is not None:
            wait_until(lambda: self.witness.pose.distance_to(start) >= moment or sent.ending, "the robot to drive on")
        pulled_at = self.witness.pose
        os.kill(pid, number)
        try:
            if node in ON_THE_WAY_TO_THE_WHEELS:
                wait_until(lambda: self.speed() < SLOW, f"the robot to stand without {node}")
                self.assertLess(self.witness.pose.distance_to(pulled_at), 0.25, f"it drove on without {node}")
        finally:
            if number == signal.SIGSTOP:
                os.kill(pid, signal.SIGCONT)
        self.client.cancel_all()

    def wait_until_all_is_back(self):
        """Wait until every node answers and the robot knows where it is."""
        for node in NODES:
            wait_until(lambda node=node: is_alive(node), f"{node} to be back", 60.0)
        for client in (self.client, self.flex):
            self.assertTrue(client.wait_for_server(60.0), f"waited 60 s for {client.name}, in vain")
        wait_until(self.knows_its_place, "a fresh pose", 60.0)
        wait_until(lambda: self.speed() < SLOW, "the robot to stand")

    def knows_its_place(self):
        try:
            return self.transforms.lookup("map", "base_footprint", max_age=1.0)
        except TransformError:
            return None


def is_alive(node):
    try:
        return node_pid(node, rospy.get_name())
    except (OSError, rosgraph.MasterException):
        return None


if __name__ == "__main__":
    start_test_node("pulled_nodes_test")
    rostest.rosrun("mbf_relay", "pulled_nodes", TestPulledNodes)
