"""What tests of the server with its own plugins share: a bare room, wheels and scans made of paper, and clients."""

import math
import os
import sys
import threading
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import numpy as np
import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist
from mbf_msgs.msg import (
    ExePathAction,
    ExePathGoal,
    ExePathResult,
    GetPathAction,
    GetPathGoal,
    GetPathResult,
    MoveBaseAction,
    MoveBaseResult,
    RecoveryAction,
    RecoveryResult,
)
from nav_msgs.msg import OccupancyGrid
from node.paper_wheels import PaperWheels
from ros_testing import Listener, wait_until
from sensor_msgs.msg import LaserScan

from mbf_relay.geometry import Pose2D
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.common.actions.action_client import ActionClient
from mbf_relay.ros.common.conversions import header, map_to_message
from mbf_relay.ros.common.outcome_codes import name_of
from mbf_relay.ros.common.transforms import TransformPublisher

INF = float("inf")
ACTIONS = {
    "get_path": (GetPathAction, GetPathResult), "exe_path": (ExePathAction, ExePathResult),
    "recovery": (RecoveryAction, RecoveryResult), "move_base": (MoveBaseAction, MoveBaseResult),
}
OLDER = {"BLOCKED_START": "INVALID_START", "BLOCKED_GOAL": "INVALID_GOAL"}
"""What release 0.4.0 of mbf_msgs has for names that came later."""
STATES = {value: name for name, value in vars(GoalStatus).items() if name.isupper()}
BURGER = np.array([[-0.105, -0.105], [-0.105, 0.105], [0.041, 0.105], [0.041, -0.105]])
PADDING = 0.01
SIDE, CELL = 6.0, 0.05
"""The room: a square, its walls two cells thick, the robot in its middle."""


def room():
    cells = int(SIDE / CELL)
    data = np.zeros((cells, cells), dtype=np.int8)
    data[:2, :] = data[-2:, :] = data[:, :2] = data[:, -2:] = 100
    data[80:84, 80:100] = 100
    return OccupancyMap(data, CELL, Pose2D(-SIDE / 2.0, -SIDE / 2.0, 0.0))


def pose_at(x, y=0.0, frame="map", quaternion=(0.0, 0.0, 0.0, 1.0)):
    pose = PoseStamped(pose=Pose(Point(x, y, 0.0), Quaternion(*quaternion)))
    pose.header.frame_id = frame
    return pose


def path_of(*xs, frame="map"):
    goal = ExePathGoal()
    goal.path.header.frame_id = frame
    goal.path.poses = [pose_at(x, frame=frame) for x in xs]
    return goal


def is_zero(twist):
    return twist.linear.x == twist.linear.y == twist.angular.z == 0.0


class MoveBaseFlexCase(unittest.TestCase):
    """The room, the wheels and the scans round a running server, and clients of its four actions."""

    @classmethod
    def setUpClass(cls):
        cls.map = rospy.Publisher("map", OccupancyGrid, queue_size=1, latch=True)
        cls.map.publish(map_to_message(room(), "map", 0.0))
        cls.wheels = PaperWheels("base_footprint")
        cls.scans = rospy.Publisher("scan", LaserScan, queue_size=1)
        cls.tf = TransformPublisher()
        cls.scanning, cls.over = threading.Event(), threading.Event()
        cls.scanning.set()
        threading.Thread(target=cls.scan, daemon=True).start()
        cls.velocity = Listener("cmd_vel", Twist)
        cls.clients = {name: ActionClient(f"move_base_flex/{name}", types[0]) for name, types in ACTIONS.items()}
        for name, client in cls.clients.items():
            assert client.wait_for_server(60.0), f"waited 60 s for the action {name}, in vain"
        ending = cls.clients["get_path"].send(GetPathGoal(target_pose=pose_at(1.0))).wait(30.0)
        assert ending.status == GoalStatus.SUCCEEDED, ending.text

    @classmethod
    def tearDownClass(cls):
        cls.over.set()

    @classmethod
    def scan(cls):
        """See nothing within range, ten times a second, unless told not to."""
        while not cls.over.wait(0.1) and not rospy.is_shutdown():
            if cls.scanning.is_set():
                top = header("base_footprint", rospy.get_rostime() - rospy.Duration(0.03))
                cls.scans.publish(LaserScan(top, -math.pi, math.pi, math.pi / 90, 0.0, 0.1, 0.12, 3.5, [INF] * 180, []))

    def end_of(self, action, goal, timeout=30.0):
        ending = self.clients[action].send(goal).wait(timeout)
        self.assertIsNotNone(ending, f"waited {timeout} s for the end of {action}, in vain")
        return ending

    def assert_outcome(self, action, goal, outcome, state="ABORTED", words=""):
        ending = self.end_of(action, goal)
        types = {
            "get_path": GetPathResult,
            "exe_path": ExePathResult,
            "recovery": RecoveryResult,
            "move_base": GetPathResult,
        }
        got = name_of(ending.result.outcome, types[action])
        expected = outcome if hasattr(types[action], outcome) else OLDER[outcome]
        self.assertEqual((STATES[ending.status], got), (state, expected), f"{action}: {ending.text}")
        self.assertIn(words, ending.result.message)

    def drive(self):
        """Start a drive along x, from wherever random goals have left the robot, and wait until it moves."""
        feedback = []
        here, goal = self.wheels.pose, path_of()
        goal.path.poses = [pose_at(here.x + (0.1 if here.x < 0.0 else -0.1) * step, here.y) for step in range(20)]
        sent = self.clients["exe_path"].send(goal, on_feedback=feedback.append)
        count = len(self.velocity.messages)
        wait_until(lambda: not all(map(is_zero, self.velocity.messages[count:])), "a velocity")
        return sent, feedback
