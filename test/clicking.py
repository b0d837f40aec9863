"""What the clicking tests share: the demo's graph, RViz on a virtual screen, and a robot to look after."""

import os
import unittest

import rospkg
import rospy
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from move_base_msgs.msg import MoveBaseActionResult
from nav_msgs.msg import Odometry
from ros_testing import Listener, wait_until
from sensor_msgs.msg import LaserScan
from virtual_screen import RViz, VirtualScreen

from mbf_relay.geometry import Pose2D, angle_between
from mbf_relay.ros.common.conversions import pose_from_message
from mbf_relay.ros.common.rospy_patches import connecting
from mbf_relay.ros.common.transforms import Transforms

RESULTS = os.environ.get("MBF_RELAY_TEST_RESULTS", ".")
PREEMPTED, SUCCEEDED = 2, 3
PRESSES = 6


class ClickingTest(unittest.TestCase):
    """RViz with the package's own file over a running graph."""

    @classmethod
    def setUpClass(cls):
        cls.truth = Listener("ground_truth", Odometry, connected=True)
        cls.goals = Listener("move_base_simple/goal", PoseStamped)
        cls.poses = Listener("initialpose", PoseWithCovarianceStamped)
        cls.results = Listener("move_base/result", MoveBaseActionResult, connected=True)
        cls.scans = Listener("scan", LaserScan)
        cls.transforms = Transforms()
        wait_until(lambda: cls.truth.last and cls.scans.last, "the simulator's first messages", 60.0)
        wait_until(lambda: cls.transforms.can_transform("map", "base_footprint", 0.0), "localization", 60.0)
        cls.screen = VirtualScreen().__enter__()
        cls.addClassCleanup(cls.screen.__exit__)  # where RViz never shows itself, too
        config = os.path.join(rospkg.RosPack().get_path("mbf_relay"), "config", "rviz", "navigation.rviz")
        cls.rviz = RViz(cls.screen, config, os.path.join(RESULTS, "rviz.log"))

    @classmethod
    def tearDownClass(cls):
        cls.screen.screenshot(os.path.join(RESULTS, "rviz.png"))

    @property
    def true_pose(self) -> Pose2D:
        """Where the robot stands."""
        return pose_from_message(self.truth.last.pose.pose)

    @property
    def believed_pose(self) -> Pose2D:
        """Where localization believes it stands."""
        return self.transforms.lookup("map", "base_footprint")

    def click_pose(self, pose: Pose2D) -> Pose2D:
        """Drag 2D Pose Estimate over a pose in the map and return what RViz made of it."""
        return self._click("p", self.poses, pose, lambda message: message.pose.pose)

    def click_goal(self, pose: Pose2D) -> Pose2D:
        """Drag 2D Nav Goal over a pose in the map and return what RViz made of it."""
        return self._click("g", self.goals, pose, lambda message: message.pose)

    def _click(self, key, listener, pose, part):
        # A renderer without a graphics card may miss a first press: a person presses again.
        for _ in range(PRESSES):
            before = len(listener.messages)
            self.rviz.drag(key, pose.x, pose.y, pose.theta)
            try:
                wait_until(lambda: len(listener.messages) > before, f"RViz to publish {listener.topic}", 4.0)
            except AssertionError:
                continue
            clicked = pose_from_message(part(listener.last))
            self.assertLess(clicked.distance_to(pose), 0.05, "RViz's view is not where the test takes it to be")
            self.assertLess(abs(angle_between(clicked.theta, pose.theta)), 0.1)
            return clicked
        self.fail(f"RViz published nothing on {listener.topic} after {PRESSES} clicks")
        return None

    def assert_reaches(self, goal: Pose2D) -> None:
        """Wait until the clicked goal's result is there and the robot really stands at the pose.

        A press that RViz takes late replaces the goal of the press before.
        """
        result = self.results.wait_for(
            lambda message: message.status.status != PREEMPTED, "the result of the clicked goal", 90.0)
        self.assertEqual(result.status.status, SUCCEEDED, result.status.text)
        self.assertLess(self.true_pose.distance_to(goal), 0.15)
        self.assertLess(abs(angle_between(self.true_pose.theta, goal.theta)), 0.35)


def start() -> None:
    """Register the test's node, which hears RViz as the nodes do."""
    connecting.apply_patches()
    rospy.init_node("clicking_test")
