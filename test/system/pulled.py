"""What the tests share that kill or freeze something while the robot drives."""

import os
import sys
import time
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

import rosgraph  # noqa: E402
import rospy  # noqa: E402
from actionlib_msgs.msg import GoalStatus  # noqa: E402
from benchmark.processes import node_pid  # noqa: E402
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist  # noqa: E402
from mbf_msgs.msg import MoveBaseAction as FlexAction  # noqa: E402
from mbf_msgs.msg import MoveBaseActionResult  # noqa: E402
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402
from ros_testing import LOOK_PERIOD, Listener, wait_until  # noqa: E402
from running_stack import Witness  # noqa: E402

from mbf_relay.outcomes import TransformError  # noqa: E402
from mbf_relay.ros.common.actions.action_client import ActionClient  # noqa: E402
from mbf_relay.ros.common.transforms import Transforms  # noqa: E402

NODES = ("/move_base_flex", "/velocity_guard", "/move_base", "/amcl", "/map_server", "/robot_state_publisher")
SLOW = 0.01
"""Metres and radians per second below which a robot counts as standing."""


def goal_at(place):
    """Return move_base's goal for a place of the circle."""
    x, y, z, w = place
    pose = PoseStamped(pose=Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, z, w)))
    pose.header.frame_id = "map"
    return MoveBaseGoal(pose)


def pid_of(node):
    """Return a node's process, None while there is none."""
    try:
        return node_pid(node, rospy.get_name())
    except (OSError, rosgraph.MasterException):
        return None


class PulledCase(unittest.TestCase):
    """The robot's graph and one who sends it goals. roslaunch starts again what was killed."""

    @classmethod
    def setUpClass(cls):
        cls.witness = Witness()
        cls.truth = Listener("ground_truth", Odometry, connected=True)
        cls.outcomes = Listener("move_base/navigation_outcome", MoveBaseActionResult, connected=True)
        cls.client = ActionClient("move_base", MoveBaseAction)
        cls.flex = ActionClient("move_base_flex/move_base", FlexAction)
        cls.commands = Listener("cmd_vel", Twist, connected=True)
        cls.transforms = Transforms()
        wait_until(lambda: cls.truth.last, "the simulator's truth")

    def setUp(self):
        for client in (self.client, self.flex):
            self.assertTrue(client.wait_for_server(60.0), f"waited 60 s for {client.name}, in vain")

    def speed(self):
        """Return how fast the robot really is, in m/s or rad/s."""
        twist = self.truth.last.twist.twist
        return max(abs(twist.linear.x), abs(twist.angular.z))

    def drive(self, place):
        """Send a goal and wait until the robot drives straight on."""
        sent = self.client.send(goal_at(place))
        wait_until(lambda: self.truth.last.twist.twist.linear.x > 0.1 or sent.ending, "the robot to drive")
        self.assertIsNone(sent.ending)
        return sent

    def wait_for_way(self, metres, sent):
        """Wait until the robot has come so far, or the goal that was sent has ended."""
        start = self.witness.pose
        wait_until(lambda: self.witness.pose.distance_to(start) >= metres or sent.ending, "the robot to drive on")

    def signal(self, node, number):
        """Send a signal to a node; returns its process and where the robot was."""
        pid = pid_of(node)
        self.pulled_from, self.pulled_at, self.heard = self.witness.pose, time.monotonic(), len(self.commands.messages)
        os.kill(pid, number)
        return pid

    def wait_until_told_to_stand(self, what, made=None):
        """Wait for a zero as the last word to the wheels, or a robot that stands without.

        Args:
            what: Was pulled.
            made: The trial that this is part of.
        """
        wait_until(lambda: self.is_told_to_stand() or self.speed() < SLOW, f"a zero as the last velocity after {what}")
        waited = time.monotonic() - self.pulled_at
        rospy.loginfo("%s: told to stand within %.2f s", what, waited)
        if made is not None:
            made.measure(f"{what}, told to stand after", waited, "s")

    def check_told_to_stand(self, what, within, made=None):
        """Expect the same, and that the robot has come no farther meanwhile than `within` (m)."""
        self.wait_until_told_to_stand(what, made)
        way = self.witness.pose.distance_to(self.pulled_from)
        rospy.loginfo("%s: told to stand within %.3f m", what, way)
        if made is not None:
            made.measure(f"{what}, told to stand within", way, "m")
        self.assertLess(way, within, f"it drove on after {what}")

    def is_told_to_stand(self):
        """Return whether a zero has come since the last signal and no other velocity after it."""
        return self.commands.messages[self.heard:] and self.commands.last == Twist()

    def check_stop(self, sent, words):
        """Expect the goal to be aborted for a reason that matches the words, and the robot to stand."""
        ending = sent.wait(60.0)
        self.assertIsNotNone(ending, "waited 60 s for the end of the goal, in vain")
        self.assertEqual(ending.status, GoalStatus.ABORTED)
        outcome = self.outcomes.wait_for(lambda m: m.status.goal_id.id == sent.goal_id, "the goal's outcome")
        self.assertRegex(outcome.result.message, words)
        wait_until(lambda: self.commands.last == Twist(), "a zero as the last velocity")
        wait_until(lambda: self.speed() < SLOW, "the robot to stand")

    def check_arrival(self, sent, what):
        """Expect a goal to be reached, and nothing to have been touched."""
        ending = sent.wait(120.0)
        self.assertIsNotNone(ending, f"waited 120 s for the goal after {what}, in vain")
        self.assertEqual(ending.status, GoalStatus.SUCCEEDED, f"after {what}: {ending.text}")
        self.assertEqual(self.witness.touched(), [])

    def check_next_goal(self, place, what):
        """Expect the next goal to be reached, once everything is back."""
        self.wait_until_all_is_back()
        self.check_arrival(self.client.send(goal_at(place)), what)

    def wait_until_all_is_back(self):
        """Wait until every node answers and the robot knows where it is."""
        for node in NODES:
            wait_until(lambda node=node: pid_of(node), f"{node} to be back", 60.0, LOOK_PERIOD)
        for client in (self.client, self.flex):
            self.assertTrue(client.wait_for_server(60.0), f"waited 60 s for {client.name}, in vain")
        wait_until(self.knows_its_place, "a fresh pose", 60.0)
        wait_until(lambda: self.speed() < SLOW, "the robot to stand")

    def knows_its_place(self):
        """Return the pose in the map, None where it is not known."""
        try:
            return self.transforms.lookup("map", "base_footprint", max_age=1.0)
        except TransformError:
            return None
