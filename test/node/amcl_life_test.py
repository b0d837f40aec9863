#!/usr/bin/env python3
"""amcl from start to restart: maps by topic and service, the pose on the parameter server, lidars mounted oddly."""

import itertools
import math
import os
import signal
import subprocess
import sys
import unittest

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap, GetMapResponse, SetMap
from std_srvs.srv import Empty

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from programs import program  # noqa: E402
from ros_testing import Listener, connected_publisher, wait_until  # noqa: E402
from synthetic_room import RoomRobot, initial_pose_message, synthetic_room  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.maps import OccupancyMap  # noqa: E402
from mbf_relay.ros.common.conversions import map_to_message, pose_from_message  # noqa: E402

START = Pose2D(0.0, 1.0, 0.4)
LIDARS = (
    ("base_scan", "scan", Pose2D(-0.03, 0.0, 0.0), False),
    ("under_scan", "scan_under", Pose2D(0.1, 0.05, 0.7), True),
    ("rear_scan", "scan_rear", Pose2D(-0.1, 0.0, math.pi), False),
)
USUAL = {
    "base_frame_id": "base_footprint", "update_min_d": 0.05, "update_min_a": 0.05, "resample_interval": 1, "seed": 3,
    "tf_broadcast": "false", "initial_pose_x": START.x, "initial_pose_y": START.y, "initial_pose_a": START.theta,
}


class Amcl:
    """An amcl node in a namespace of its own."""

    def __init__(self, namespace, scan="scan", **parameters):
        self.namespace = namespace
        arguments = [f"_{name}:={value}" for name, value in {**USUAL, **parameters}.items() if value is not None]
        self._process = subprocess.Popen(
            [program("amcl"), f"__ns:=/{namespace}", f"scan:=/{scan}"] + arguments, start_new_session=True
        )
        self.poses = Listener(f"/{namespace}/amcl_pose", PoseWithCovarianceStamped, connected=True)

    def end(self, number=signal.SIGINT):
        """Interrupt the node as roslaunch does, or send it another signal, and wait for its end."""
        if self._process.poll() is None:
            os.killpg(self._process.pid, number)
        self._process.wait(timeout=20)
        self.poses.close()

    def service(self, name, kind):
        rospy.wait_for_service(f"/{self.namespace}/{name}", 20.0)
        return rospy.ServiceProxy(f"/{self.namespace}/{name}", kind)

    def estimate(self):
        """Return the pose of an update made now."""
        count = len(self.poses.messages)
        update = self.service("request_nomotion_update", Empty)

        def updated():
            update()
            return len(self.poses.messages) > count

        wait_until(updated, "an update on request", period=0.1)
        return pose_from_message(self.poses.last.pose.pose)


def turned(room):
    """Return the same room on cells laid out a quarter turn round, with a margin on two sides."""
    data = np.pad(np.rot90(room.data), ((0, 30), (0, 40)), constant_values=-1)
    corner = Pose2D(room.data.shape[1] * room.resolution, 0.0, math.pi / 2.0)
    return OccupancyMap(np.ascontiguousarray(data), room.resolution, room.origin.compose(corner))


def moved(room, x):
    return OccupancyMap(room.data, room.resolution, Pose2D(room.origin.x + x, room.origin.y, room.origin.theta))


def message_of(room):
    return map_to_message(room, "map", rospy.get_rostime())


class TestLife(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.room = synthetic_room()
        cls.robot = RoomRobot(cls.room, START, LIDARS)

    @classmethod
    def tearDownClass(cls):
        cls.robot.stop()

    def setUp(self):
        self.robot.velocity = (0.0, 0.0)
        self.robot.change_message = lambda message: message
        self.robot.change_ranges = lambda ranges: ranges
        self.here = self.robot.pose
        self.nodes, self.services = [], []

    def tearDown(self):
        self.robot.velocity = (0.0, 0.0)
        for node in self.nodes:
            node.end()
        for service in self.services:
            service.shutdown()

    def amcl(self, namespace, served=None, **parameters):
        if served is not None:
            self.services.append(
                rospy.Service(f"/{namespace}/static_map", GetMap, lambda _: GetMapResponse(message_of(served)))
            )
        here = {"initial_pose_x": self.here.x, "initial_pose_y": self.here.y, "initial_pose_a": self.here.theta}
        node = Amcl(namespace, **{**here, **parameters})
        self.nodes.append(node)
        return node

    def drive(self, metres):
        begun = self.robot.pose
        self.robot.velocity = (0.2, 0.1)
        wait_until(lambda: self.robot.pose.distance_to(begun) > metres, "the robot to drive")
        self.robot.velocity = (0.0, 0.0)
        self.here = self.robot.pose

    def assert_at(self, node, x=0.0, within=0.1):
        """Assert that estimates settle on where the robot is, `x` metres farther along the map's x axis."""
        self.here = self.robot.pose
        wanted = Pose2D(self.here.x + x, self.here.y, self.here.theta)
        wait_until(lambda: node.estimate().distance_to(wanted) < within, f"{node.namespace} to say {wanted}", 20.0)

    def test_maps_come_by_topic_one_after_the_other(self):
        node = self.amcl("by_topic", use_map_topic="true")
        maps = connected_publisher("/by_topic/map", OccupancyGrid, latch=True)
        maps.publish(message_of(self.room))
        self.assert_at(node)
        for replaced, x in ((moved(self.room, 0.3), 0.3), (turned(self.room), 0.0)):
            maps.publish(message_of(replaced))
            self.assert_at(node, x)
        empty = message_of(self.room)
        empty.info.width, empty.info.height, empty.data = 0, 0, []
        maps.publish(empty)
        self.drive(0.3)
        self.assert_at(node)

    def test_only_the_first_map_counts_where_asked_for(self):
        node = self.amcl("first_only", use_map_topic="true", first_map_only="true")
        maps = connected_publisher("/first_only/map", OccupancyGrid, latch=True)
        maps.publish(message_of(self.room))
        self.assert_at(node)
        maps.publish(message_of(moved(self.room, 0.3)))
        for _ in range(8):
            estimate = node.estimate()
        self.assertLess(estimate.distance_to(self.robot.pose), 0.1)
        # The service is another door; what it brings is wanted.
        set_map = node.service("set_map", SetMap)
        self.assertTrue(set_map(message_of(moved(self.room, 0.3)), initial_pose_message(self.here)).success)
        self.assert_at(node, 0.3)

    def test_a_map_by_service_is_taken_with_its_pose_or_not_at_all(self):
        node = self.amcl("by_service", self.room)
        self.assert_at(node)
        set_map, other = node.service("set_map", SetMap), message_of(moved(self.room, 0.3))
        for bad in (
            initial_pose_message(Pose2D(200.0, 0.0, 0.0)), initial_pose_message(self.here, frame="odom"),
            initial_pose_message(self.here, variance=math.nan),
        ):
            self.assertFalse(set_map(other, bad).success)
        for _ in range(4):
            estimate = node.estimate()
        self.assertLess(estimate.distance_to(self.robot.pose), 0.1)
        self.assertTrue(set_map(message_of(turned(self.room)), initial_pose_message(self.here)).success)
        self.assert_at(node)

    def test_a_restarted_node_goes_on_where_it_was(self):
        node = self.amcl("restarted", self.room, save_pose_rate=2.0)
        self.assert_at(node)
        self.drive(0.8)
        self.assert_at(node)
        node.end()
        saved = Pose2D(*(rospy.get_param(f"/restarted/amcl/initial_pose_{name}") for name in "xya"))
        self.assertLess(saved.distance_to(self.robot.pose), 0.1)
        again = Amcl("restarted", initial_pose_x=None, initial_pose_y=None, initial_pose_a=None)
        self.nodes.append(again)
        first = again.poses.wait_for(lambda _: True, "the first estimate after a restart")
        self.assertLess(pose_from_message(first.pose.pose).distance_to(self.robot.pose), 0.15)

    def test_a_node_killed_in_a_drive_goes_on_where_the_robot_has_got_meanwhile(self):
        # The plain filter, which finds no robot that is not where it is told to start.
        settings = {"robust": "false", "save_pose_rate": 0.01}
        node = self.amcl("killed", self.room, **settings)
        self.assert_at(node, within=0.2)
        wait_until(lambda: rospy.has_param("/killed/amcl/saved_odom"), "the pose to be saved")
        self.drive(0.8)
        node.end(signal.SIGKILL)
        again = Amcl("killed", initial_pose_x=None, initial_pose_y=None, initial_pose_a=None, **settings)
        self.nodes.append(again)
        first = again.poses.wait_for(lambda _: True, "the first estimate after the kill")
        self.assertLess(pose_from_message(first.pose.pose).distance_to(self.robot.pose), 0.2)

    def test_a_pose_of_the_past_is_moved_by_odometry(self):
        # The plain filter with particles in one place: what it says is where it was told to start.
        node = self.amcl("past", self.room, robust="false", update_min_d=0.5)
        node.poses.wait_for(lambda _: True, "an estimate")
        publisher = connected_publisher("/past/initialpose", PoseWithCovarianceStamped)
        stamp, then = rospy.get_rostime(), self.robot.pose
        self.drive(0.5)  # it takes longer on a busy machine, and tf keeps ten seconds
        count = len(node.poses.messages)
        publisher.publish(initial_pose_message(then, stamp, variance=1e-4))
        found = node.poses.wait_for(lambda _: True, "an estimate after the initial pose", since=count)
        self.assertLess(pose_from_message(found.pose.pose).distance_to(self.robot.pose), 0.15)

    def test_lidars_upside_down_and_backwards(self):
        for namespace, scan in (("under", "scan_under"), ("rear", "scan_rear")):
            for robust in ("true", "false"):
                node = self.amcl(f"{namespace}_{robust}", self.room, scan=scan, robust=robust)
                self.drive(0.4)
                self.assert_at(node, within=0.1 if robust == "true" else 0.25)
                node.end()

    def test_scans_of_other_lengths_and_frames_do_no_harm(self):
        node = self.amcl("changing", self.room)
        self.assert_at(node)

        numbers = itertools.count()

        def cut(message):
            message.ranges = message.ranges[:len(message.ranges) // 2 + next(numbers) % 7]
            message.angle_max = message.angle_min + (len(message.ranges) - 1) * message.angle_increment
            return message

        def strange(message):
            if message.header.frame_id == "base_scan":
                message.header.frame_id = ("nowhere", "", "base_scan")[next(numbers) % 3]
            return message

        for change in (cut, strange):
            self.robot.change_message = change
            self.drive(0.4)
            self.assert_at(node)


if __name__ == "__main__":
    rospy.init_node("amcl_life_test")
    rostest.rosrun("mbf_relay", "amcl_life", TestLife)
