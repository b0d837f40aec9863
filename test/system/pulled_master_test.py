#!/usr/bin/env python3
"""The ROS master dies or hangs while the robot drives, and comes back: nobody is left driving, and goals work after.

The graph has a master of its own, for the one of this test must live.
"""

import os
import signal
import subprocess
import sys
import time
import urllib.parse
import uuid

import rospkg
import rostest
from geometry_msgs.msg import Twist

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from pulled import PulledCase, pid_of  # noqa: E402
from ros_testing import wait_until  # noqa: E402
from running_stack import run_client, start_test_node  # noqa: E402

from mbf_relay.ros.tools.demo_graph import DemoGraph  # noqa: E402
from mbf_relay.simulation.arena import CIRCLE, START  # noqa: E402

LAUNCH = os.path.join(rospkg.RosPack().get_path("mbf_relay"), "test", "system", "robot_that_comes_back.launch")
INITIAL_POSE = (
    "rostopic", "pub", "-1", "/initialpose", "geometry_msgs/PoseWithCovarianceStamped",
    f"{{header: {{frame_id: map}}, "
    f"pose: {{pose: {{position: {{x: {START.x}, y: {START.y}}}, orientation: {{w: 1.0}}}}}}}}",
)
"""A user's command; this test's own node is unknown to the new master."""
EVERYBODY = ("/simulator", "/amcl", "/map_server", "/velocity_guard", "/move_base_flex", "/move_base")


class TestPulledMaster(PulledCase):
    """Run in the order of their names; the last one leaves this node with a master that does not know it."""

    @classmethod
    def setUpClass(cls):
        cls.folder = os.path.join(rospkg.get_log_dir(), "pulled_master")
        # an id of its own: roslaunch would wait for a roscore to make one
        cls.graph = DemoGraph(["--wait", "--run_id", str(uuid.uuid4()), LAUNCH], cls.folder)
        os.environ.update(cls.graph.environment)
        cls.graph.__enter__()
        try:
            cls.start_master()
            cls.graph.wait_for_parameter("/use_sim_time", 60.0)
            start_test_node("pulled_master_test")
            super().setUpClass()
            cls.foreigner = wait_until(lambda: pid_of("/robot_state_publisher"), "robot_state_publisher")
        except BaseException:
            cls.tearDownClass()
            raise

    @classmethod
    def tearDownClass(cls):
        cls.graph.__exit__()

    @classmethod
    def start_master(cls):
        port = urllib.parse.urlsplit(cls.graph.environment["ROS_MASTER_URI"]).port
        command = ["rosmaster", "--core", "-p", str(port)]
        cls.master = cls.graph.start(command, os.path.join(cls.folder, "master.log"))

    def test_1_a_frozen_master_keeps_no_drive_waiting(self):
        sent = self.drive(CIRCLE[0])
        self.master.send_signal(signal.SIGSTOP)
        try:
            self.check_arrival(sent, "the master was frozen")
            self.check_arrival(self.drive(CIRCLE[1]), "the master was frozen for long")
        finally:
            self.master.send_signal(signal.SIGCONT)

    def test_2_without_a_master_drives_end_and_can_be_called_off(self):
        sent = self.drive(CIRCLE[2])
        self.master.kill()
        self.master.wait()
        self.check_arrival(sent, "the master was killed")
        sent = self.drive(CIRCLE[3])
        sent.cancel()
        self.pulled_from, self.pulled_at, self.heard = self.witness.pose, time.monotonic(), len(self.commands.messages)
        self.check_told_to_stand("a cancel without a master", within=0.25)
        self.assertIsNotNone(sent.wait(10.0))

    def test_3_a_new_master_finds_a_robot_that_stands_and_the_next_goal_works(self):
        self.drive(CIRCLE[4])
        self.start_master()
        wait_until(lambda: self.commands.last == Twist(), "a zero as the last velocity")
        for node in EVERYBODY:
            wait_until(lambda node=node: pid_of(node), f"{node} to be back", 90.0)
        os.kill(self.foreigner, signal.SIGTERM)  # C++ nodes know nothing of new masters; their user starts them again
        x, y = (str(value) for value in CIRCLE[0][:2])

        def arrives():
            """Tell amcl where the new simulation begins, for the robot was carried there, and send a goal.

            One sent before the costmaps are there again ends with the words that they are not.
            """
            subprocess.run(INITIAL_POSE, stdout=subprocess.DEVNULL, timeout=60.0, check=True)
            return run_client("movebase_client.py", x, y).status == 0

        wait_until(arrives, "a goal to be reached", 180.0)


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "pulled_master", TestPulledMaster)
