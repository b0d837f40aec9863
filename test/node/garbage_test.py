#!/usr/bin/env python3
"""Messages without sense on the topics of a server that drives: it goes on or stands, and it is there afterwards."""

import atexit
import math
import os
import random
import subprocess
import sys
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus, GoalStatusArray
from geometry_msgs.msg import Point, Point32, Polygon, Pose, PoseStamped, Quaternion, TransformStamped, Twist
from map_msgs.msg import OccupancyGridUpdate
from mbf_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid, Odometry
from ros_testing import Listener, connected_publisher, wait_until
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from std_srvs.srv import Empty
from tally import how_many, trial
from tf2_msgs.msg import TFMessage

from mbf_relay.ros.common.actions.action_client import ActionClient

SERVER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "garbage_server.py")
NUMBERS = (math.nan, math.inf, -math.inf, 1e300, -1e300, 1e-300, 0.0, -1.0, 2.0 ** 31, 1e9)
LATEST = rospy.Time(2 ** 32 - 1, 0)
COSTMAP = {
    "robot_base_frame": "base",
    "update_frequency": 10.0,
    "transform_tolerance": 1.0,
    "rolling_window": True,
    "width": 4.0,
    "height": 4.0,
    "resolution": 0.05,
    "robot_radius": 0.1,
    "footprint_topic": "outline",
    "plugins": [
        {"name": "obstacles", "type": "costmap_2d::ObstacleLayer"},
        {"name": "inflation", "type": "costmap_2d::InflationLayer"},
    ],
    "obstacles": {
        "observation_sources": "scan cloud",
        "scan": {"data_type": "LaserScan", "clearing": True, "expected_update_rate": 1.0},
        "cloud": {"data_type": "PointCloud2"},
    },
}
GLOBAL = {**COSTMAP, "global_frame": "map", "rolling_window": False, "plugins": [
    {"name": "static", "type": "costmap_2d::StaticLayer"}, {"name": "inflation", "type": "costmap_2d::InflationLayer"}],
    "static": {"subscribe_to_updates": True}}


def header(message, frame, stamp=None):
    message.header.frame_id = frame
    message.header.stamp = rospy.get_rostime() if stamp is None else stamp
    return message


def scan(stamp=None, frame="laser", **changes):
    message = header(LaserScan(angle_increment=math.pi / 90.0, range_min=0.1, range_max=5.0), frame, stamp)
    message.ranges = [3.0 + 0.01 * random.random() for _ in range(180)]
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def transform(parent, child, stamp=None, x=0.0, w=1.0):
    message = header(TransformStamped(child_frame_id=child), parent, stamp)
    message.transform.translation.x, message.transform.rotation.w = x, w
    return TFMessage([message])


def floor(width=400, height=400, resolution=0.05, cells=None, x=-10.0):
    message = header(OccupancyGrid(), "map")
    message.info.width, message.info.height, message.info.resolution = width, height, resolution
    message.info.origin = Pose(Point(x, -10.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))
    message.data = [0] * (width * height if cells is None else cells)
    return message


class GarbageTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("garbage_test")
        random.seed(1)
        rospy.set_param("move_base_flex", {
            "tf_timeout": 0.3, "controller_patience": 60.0, "script": {"plan_time": 0.01},
            "global_costmap": GLOBAL, "local_costmap": {**COSTMAP, "global_frame": "odom"}})
        cls.server = subprocess.Popen([sys.executable, SERVER])
        atexit.register(cls.server.kill)
        cls.client = ActionClient("move_base_flex/move_base", MoveBaseAction)
        assert cls.client.wait_for_server(90.0), "waited 90 s for the server, in vain"
        cls.velocity = Listener("cmd_vel", Twist)
        cls.odometry = Listener("odom", Odometry, connected=True)
        cls.status = Listener("move_base_flex/move_base/status", GoalStatusArray, connected=True)
        publisher = connected_publisher
        cls.scans, cls.maps = publisher("scan", LaserScan), publisher("map", OccupancyGrid)
        cls.tf, cls.tf_static = publisher("/tf", TFMessage), publisher("/tf_static", TFMessage)
        cls.clouds, cls.odometries = publisher("cloud", PointCloud2), publisher("odom", Odometry)
        cls.updates = publisher("map_updates", OccupancyGridUpdate)
        cls.outlines = publisher("move_base_flex/local_costmap/outline", Polygon)
        cls.scanner = rospy.Timer(rospy.Duration(0.1), lambda _: cls.scans.publish(scan()))
        cls.maps.publish(floor())
        cls.tf_static.publish(transform("base", "laser"))

    @classmethod
    def tearDownClass(cls):
        cls.scanner.shutdown()
        cls.server.terminate()
        cls.server.wait(20.0)

    def setUp(self):
        self.drive()

    def tearDown(self):
        self.sent.cancel()
        wait_until(lambda: self.sent.ending is not None, "the goal's end")

    def x(self):
        """Return how far (m) the robot has come; odometry without sense, of this test, says 0."""
        return max(message.pose.pose.position.x for message in self.odometry.messages[-10:])

    def drive(self):
        """Be driving to somewhere far away; a goal is sent again where the costmaps were not ready for the first."""

        def driving():
            if self.sent is None or self.sent.ending is not None:
                goal = MoveBaseGoal(target_pose=header(PoseStamped(), "map"))
                goal.target_pose.pose = Pose(Point(self.x() + 5.0, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))
                self.sent = self.client.send(goal)
            return len(self.velocity.messages) > count and self.velocity.last.linear.x > 0.1

        self.sent, count = None, len(self.velocity.messages)
        wait_until(driving, "driving", 60.0)

    def goes_on(self):
        self.assertIsNone(self.server.poll(), "the server has died")
        there = self.x() + 0.3  # m: farther than it comes once it has no more scans that it can use
        wait_until(lambda: self.x() > there, "the robot to drive on", 30.0)
        for message in self.velocity.messages:
            self.assertTrue(math.isfinite(message.linear.x) and math.isfinite(message.angular.z))

    def test_a_robot_drives_on_through_stamps_at_the_end_of_time(self):
        for stamp in (LATEST, rospy.Time(2 ** 31, 0), rospy.Time(2 ** 31 - 1, 0)):
            for _ in range(3):
                self.tf.publish(transform("somewhere", "else", stamp))
                self.tf.publish(transform("odom", "base", stamp))
                self.tf_static.publish(transform("here", "there", stamp))
                self.scans.publish(scan(stamp))
                self.clouds.publish(header(PointCloud2(), "base", stamp))
            self.goes_on()

    def test_transforms_without_sense_change_nothing(self):
        numbers = (dict(x=math.nan), dict(x=1e300), dict(w=0.0), dict(w=math.inf))
        for wrong in (
            *(transform("odom", "base", **each) for each in numbers),
            *(transform("base", "laser", **each) for each in numbers),  # whose place nobody else tells
            transform("", "base"),
            transform("odom", ""),
            transform("odom", "ba\0se"),
            transform("base", "map"),
            transform("base", "odom"),
            transform("base", "base"),
            transform("odom", "base", rospy.Time(1, 0), x=30.0),
        ):
            self.tf.publish(wrong)
            self.tf_static.publish(wrong)
        self.goes_on()

    def test_a_map_of_tiny_cells_neither_hangs_the_robot_nor_lets_it_roll_on(self):
        for wrong in (
            floor(10, 10, 1e-6),
            floor(10, 10, 0.0),
            floor(10, 10, math.nan),
            floor(10, 10, 1e9),
            floor(10, 10, cells=7),
            floor(0, 0),
            floor(10, 10, x=1e300),
            floor(40000, 1),
        ):
            self.maps.publish(wrong)
        for wrong in (
            OccupancyGridUpdate(x=2**31 - 1, width=1, height=1, data=[1]),
            OccupancyGridUpdate(x=-5, width=2, height=2, data=[1] * 4),
            OccupancyGridUpdate(width=9, height=9),
        ):
            self.updates.publish(wrong)
        self.goes_on()

    def test_scans_and_clouds_without_sense_are_left_out(self):
        fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate("xyz")]
        for changes in (
            dict(ranges=[]),
            dict(angle_increment=math.nan),
            dict(angle_min=math.inf),
            dict(range_max=math.nan),
            dict(range_min=9.0),
            dict(range_min=120.0, range_max=3500.0, ranges=[3000.0] * 180),  # in millimetres
            dict(angle_increment=1e30),
            dict(frame="nowhere"),
            dict(frame="ba\0se"),
        ):
            self.scans.publish(scan(**changes))
        for values in (
            dict(height=2**32 - 1, width=2**32 - 1),
            dict(height=1, width=5, point_step=12, row_step=60),
            dict(height=1, width=1, point_step=0, row_step=0),
            dict(height=1, width=1, point_step=4, row_step=4, data=b"1234"),
        ):
            self.clouds.publish(header(PointCloud2(fields=fields, **values), "base"))
        self.clouds.publish(header(PointCloud2(height=1, width=1, point_step=4, row_step=4, data=b"1234"), "base"))
        self.goes_on()

    def test_outlines_and_odometry_without_sense_are_left_out(self):
        for x in (math.nan, 1e30, math.inf):
            self.outlines.publish(Polygon([Point32(x, 0.0, 0.0), Point32(0.0, 1.0, 0.0), Point32(0.0, 0.0, 0.0)]))
        self.outlines.publish(Polygon([Point32(0.1, 0.1, 0.0)] * 5000))
        for x in (math.nan, 1e300):
            message = header(Odometry(), "odom")
            message.twist.twist.linear.x = x
            self.odometries.publish(message)
        self.odometries.publish(header(Odometry(), "odom", LATEST))
        self.goes_on()

    def test_numbers_of_any_kind_anywhere_neither_end_the_server_nor_reach_the_wheels(self):
        for _ in range(how_many(150, 5000)):
            self.send_anything()
        self.maps.publish(floor())
        self.outlines.publish(
            Polygon([Point32(x, y, 0.0) for x, y in ((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1))])
        )
        self.tearDown()
        self.drive()
        self.goes_on()

    @trial("messages of any kind sent to a server that drives")
    def send_anything(self):
        """Send a message with a number without sense in it."""
        value, stamp = random.choice(NUMBERS), random.choice((None, LATEST, rospy.Time(), rospy.Time(1, 0)))
        narrow = max(-3e38, min(3e38, value)) if math.isfinite(value) else value
        random.choice(
            (
                lambda: self.tf.publish(
                    transform("odom", random.choice(("base", "laser", "x")), stamp or LATEST, x=value)
                ),
                lambda: self.scans.publish(
                    scan(
                        stamp, **{random.choice(("angle_min", "angle_increment", "range_min", "range_max")): narrow}
                    )
                ),
                lambda: self.scans.publish(
                    scan(stamp or LATEST, ranges=[narrow] * random.choice((0, 1, 180, 5000)))
                ),
                lambda: self.maps.publish(
                    floor(*random.choice(((1, 1), (3, 7), (200, 200))), resolution=narrow, x=value)
                ),
                lambda: self.outlines.publish(
                    Polygon([Point32(narrow, random.random(), 0.0) for _ in range(random.randrange(6))])
                ),
                lambda: self.updates.publish(
                    OccupancyGridUpdate(
                        x=random.randint(-(2**31), 2**31 - 1),
                        width=random.choice((0, 1, 2**32 - 1)),
                        height=1,
                        data=[0],
                    )
                ),
            )
        )()
        self.assertIsNone(self.server.poll(), "the server has died")

    def test_a_goal_in_a_frame_no_name_can_mean_ends_alone_and_in_a_sentence(self):
        goal = MoveBaseGoal(target_pose=header(PoseStamped(), "m\0ap"))
        goal.target_pose.pose.orientation.w = 1.0
        sent = self.client.send(goal)
        wait_until(lambda: sent.ending is not None, "the goal's end")
        self.assertIn("names no frame", sent.ending.text)
        self.drive()
        self.goes_on()

    def test_a_robot_whose_navigation_hangs_stands_and_its_goal_ends(self):
        rospy.ServiceProxy("move_base_flex/hang", Empty)()
        try:
            wait_until(lambda: self.sent.ending is not None, "the goal's end, while navigation hangs")
            wait_until(lambda: self.velocity.last.linear.x == 0.0, "a zero as the last velocity, while it hangs")
        finally:
            rospy.ServiceProxy("move_base_flex/go_on", Empty)()
        self.assertEqual(self.sent.ending.status, GoalStatus.ABORTED)
        self.assertIn("hangs in garbage_server.py, line ", self.sent.ending.text)
        count = len(self.velocity.messages)
        self.drive()
        self.assertGreater(len(self.velocity.messages), count)
        self.goes_on()


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "garbage", GarbageTest)
