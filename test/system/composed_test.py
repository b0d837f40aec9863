#!/usr/bin/env python3
"""Nodes forked from one parent: nobody sees a difference, and each may die without the others."""

import os
import signal
import subprocess
import sys
import tempfile
import unittest

import psutil
import rosgraph
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from std_srvs.srv import Empty

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from benchmark.processes import node_pid  # noqa: E402
from programs import program  # noqa: E402
from ros_testing import wait_until  # noqa: E402
from running_stack import Witness, run_client, start_test_node  # noqa: E402

from mbf_relay.outcomes import TransformError  # noqa: E402
from mbf_relay.ros.common.actions.action_client import ActionClient  # noqa: E402
from mbf_relay.ros.common.transforms import Transforms  # noqa: E402
from mbf_relay.ros.tools.demo_graph import DemoGraph  # noqa: E402
from mbf_relay.simulation.arena import CIRCLE  # noqa: E402

NODES = ("/map_server", "/amcl", "/move_base_flex", "/move_base")
NEAR = ("-1.5", "-0.5")
"""A place (m) half a metre ahead of the robot's start."""


def offers(uri):
    """Return what the nodes publish, take and serve, by the master at `uri`."""
    state = rosgraph.Master("/composed_test", master_uri=uri).getSystemState()
    return {
        (kind, topic, node)
        for kind, topics in zip(("publishes", "takes", "serves"), state) for topic, nodes in topics
        for node in nodes if node in NODES
    }


def process_of(node):
    try:
        return node_pid(node, rospy.get_name())
    except (OSError, rosgraph.MasterException):
        return None


class TestComposed(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.witness = Witness()
        cls.client = ActionClient("move_base", MoveBaseAction)
        cls.transforms = Transforms()

    def test_1_names_are_those_of_single_nodes(self):
        run = run_client("movebase_client.py", *NEAR)
        self.assertEqual(run.status, 0, run.output)
        rospy.ServiceProxy("simulator/pause", Empty)()  # these have nothing to do while the others drive
        with tempfile.TemporaryDirectory() as folder, DemoGraph(
            ["mbf_relay", "demo.launch", "real_time_factor:=2.0"], folder
        ) as single:
            single.wait_for_parameter("/use_sim_time", 60.0)
            client = subprocess.run(
                [program("movebase_client.py"), *NEAR], env=single.environment, stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT, timeout=240.0,
            )
            self.assertEqual(client.returncode, 0, client.stdout)
            expected = offers(single.environment["ROS_MASTER_URI"])
        self.assertGreater(len(expected), 100)
        rospy.ServiceProxy("simulator/unpause", Empty)()
        self.assertEqual(offers(os.environ["ROS_MASTER_URI"]), expected)

    def test_2_one_parent_has_them_all(self):
        parent, = {psutil.Process(process_of(node)).ppid() for node in NODES}
        self.assertIn("compose", " ".join(psutil.Process(parent).cmdline()))
        self.assertEqual(psutil.Process(parent).num_threads(), 1)

    def test_3_each_may_be_killed_and_the_next_goal_is_reached(self):
        for node, place in zip(NODES, (CIRCLE[0], CIRCLE[-1]) * 2):
            killed = process_of(node)
            others = {other: process_of(other) for other in NODES if other != node}
            os.kill(killed, signal.SIGKILL)
            wait_until(
                lambda node=node, killed=killed: process_of(node) not in (None, killed), f"another {node}", 60.0, 0.1)
            self.assertEqual({other: process_of(other) for other in others}, others)
            self.assertTrue(self.client.wait_for_server(60.0), "waited 60 s for move_base, in vain")
            wait_until(self.knows_its_place, "a fresh pose", 60.0)
            ending = self.drive(place)
            self.assertEqual(ending.status, GoalStatus.SUCCEEDED, f"after {node} was killed: {ending.text}")
        self.assertEqual(self.witness.touched(), [])

    def knows_its_place(self):
        try:
            return self.transforms.lookup("map", "base_footprint", max_age=1.0)
        except TransformError:
            return None

    def drive(self, place):
        x, y, z, w = place
        pose = PoseStamped(pose=Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, z, w)))
        pose.header.frame_id = "map"
        ending = self.client.send(MoveBaseGoal(pose)).wait(120.0)
        self.assertIsNotNone(ending, "waited 120 s for a goal, in vain")
        return ending


if __name__ == "__main__":
    start_test_node("composed_test")
    rostest.rosrun("mbf_relay", "composed", TestComposed)
