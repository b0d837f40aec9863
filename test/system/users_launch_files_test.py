#!/usr/bin/env python3
"""Users' launch files drive their robots: with another `pkg`, or as they stand where there are shims."""

import contextlib
import math
import os
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import actionlib
import rosgraph
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import Odometry
from visualization_msgs.msg import MarkerArray

TEST = Path(os.path.abspath(__file__)).parents[1]
sys.path.insert(0, str(TEST))

import users_launch_files  # noqa: E402
from ros_testing import Listener, wait_until  # noqa: E402
from tally import LONG  # noqa: E402

ROOT = TEST.parent
MAP = ROOT / "config" / "maps" / "turtlebot3_world.yaml"
START, STEP = (-2.0, -0.5), 0.6
"""Where the simulated robot stands, and how far (m) it is sent."""
TOLERANCE = 0.1
"""The widest xy_goal_tolerance (m) of the files that are driven with."""
AS_THEY_STAND = ("turtlebot3", "flex")
"""Started by `scripts/run --shims`, with not a letter changed."""
RELAYED = ("flex",)
"""Driven by server and relay."""
ROBOTS = {
    "turtlebot2": {"scan": "kinect_scan", "cmd_vel": "navigation_velocity_smoother/raw_cmd_vel"},
    "outdoor": {"scan": "front/scan", "odom": "odometry/filtered"},
    "mapless": {"scan": "front/scan", "odom": "odometry/filtered"},
    "keepout_map": {"scan": "base_scan"},
    "fleet": {"name": "robot1"},
    "other_name": {"scan": "base_scan", "odom": "base_odometry/odom", "cmd_vel": "navigation/cmd_vel",
                   "scan_rate": "10"},
}
"""A robot's name, topics and rate of its lidar (Hz), where not none, scan, odom, cmd_vel and 5."""
QUICK = ("fleet", "flex", "mapless", "other_name", "turtlebot3")
DRIVEN = users_launch_files.NAMES if LONG else QUICK
OF_THE_MASTER = ("rosdistro", "roslaunch", "rosversion", "run_id")


class TestUsersLaunchFiles(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.running = []

    def tearDown(self):
        for process in reversed(self.running):
            process.send_signal(signal.SIGINT)
            process.wait(60.0)
        subprocess.run(["rosnode", "cleanup"], input=b"y\n", stdout=subprocess.DEVNULL, timeout=30.0, check=True)
        # The master is asked, since rospy answers for "/" with the few parameters it has cached.
        names = {name.split("/")[1] for name in rosgraph.Master(rospy.get_name()).getParamNames()}
        for name in names - set(OF_THE_MASTER):
            with contextlib.suppress(KeyError):  # its node took it away itself
                rospy.delete_param(f"/{name}")
        self.folder.cleanup()

    def launch(self, path, arguments, shims=False):
        """Launch a file in this process's group: rostest interrupts that, and no tearDown runs then."""
        command = ["roslaunch", str(path), *(f"{name}:={value}" for name, value in arguments.items())]
        before = [str(ROOT / "scripts" / "run"), "--shims"] if shims else []
        self.running.append(subprocess.Popen(before + command))

    def is_up(self, client):
        """Return whether the action is there; fail where what was launched has ended."""
        self.assertEqual([process.poll() for process in self.running], [None] * len(self.running))
        return client.wait_for_server(rospy.Duration(0.1))

    def drive(self, name):
        robot = ROBOTS.get(name, {})
        space = f"/{robot['name']}" if "name" in robot else ""
        self.launch(TEST / "system" / "users_robot.launch", robot)
        truth = Listener(f"{space}/ground_truth", Odometry)
        wait_until(lambda: truth.last, f"{name}'s robot", 60.0)  # and with it the simulated clock
        if name in RELAYED:
            rospy.set_param("/move_base/silence_timeout", 3.0)  # what a busy machine keeps waiting does not hang
        shims = name in AS_THEY_STAND
        folder = users_launch_files.FOLDER if shims else users_launch_files.swapped_into(Path(self.folder.name))
        self.launch(folder / f"{name}.launch", users_launch_files.arguments_of(name, MAP), shims)

        contacts = Listener(f"{space}/contacts", MarkerArray)
        client = actionlib.SimpleActionClient(f"{space}/move_base", MoveBaseAction)
        wait_until(lambda: self.is_up(client), f"{name}'s action move_base", 600.0)
        goal, target = MoveBaseGoal(), (START[0] + STEP, START[1])
        goal.target_pose.header.frame_id = "odom" if name == "mapless" else "map"
        x, y = (STEP, 0.0) if name == "mapless" else target
        goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = x, y
        goal.target_pose.pose.orientation.w = 1.0
        client.send_goal(goal)
        ended = (GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.PREEMPTED, GoalStatus.REJECTED)
        wait_until(lambda: client.get_state() in ended, f"the end of {name}'s goal", 120.0)
        self.assertEqual((client.get_state(), client.get_goal_status_text()), (GoalStatus.SUCCEEDED, "Goal reached."))
        where = truth.last.pose.pose.position
        self.assertLess(math.hypot(where.x - target[0], where.y - target[1]), TOLERANCE + 0.05)
        touched = [marker.ns for m in contacts.messages for marker in m.markers if marker.action == marker.ADD]
        self.assertEqual(touched, [])
        for listener in (truth, contacts):
            listener.close()


def _test_of(name):
    def test(self):
        self.drive(name)

    return test


for _name in DRIVEN:
    setattr(TestUsersLaunchFiles, f"test_{_name}_drives_as_it_did_under_move_base", _test_of(_name))


if __name__ == "__main__":
    rospy.init_node("users_launch_files_test")
    rostest.rosrun("mbf_relay", "users_launch_files", TestUsersLaunchFiles)
