#!/usr/bin/env python3
"""The amcl node on topics: what comes out, what the services do, and what bad input leaves unharmed."""

import copy
import functools
import math
import os
import sys
import unittest

import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMap, GetMapResponse, SetMap
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from std_msgs.msg import Float64
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from ros_testing import Listener, connected_publisher, wait_until  # noqa: E402
from synthetic_room import RoomRobot, initial_pose_message, mounting, synthetic_room  # noqa: E402

from mbf_relay.geometry import Pose2D, angle_between  # noqa: E402
from mbf_relay.outcomes import TransformError  # noqa: E402
from mbf_relay.ros.common.conversions import map_to_message, pose_from_message  # noqa: E402
from mbf_relay.ros.common.transforms import Transforms  # noqa: E402

START = Pose2D(0.0, 1.0, 0.4)
initial_pose = functools.partial(initial_pose_message, variance=0.02)


def cloud_of(scan):
    """Return a scan as a lidar of three rings would send it, with a floor below."""
    ranges = np.array(scan.ranges)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    ring = np.column_stack((ranges * np.cos(angles), ranges * np.sin(angles)))[np.isfinite(ranges)]
    points = np.vstack([np.column_stack((scale * ring, np.full(len(ring), height)))
                        for scale, height in ((1.0, 0.2), (1.0, 0.4), (1.0, 0.6), (0.5, 0.0))]).astype(np.float32)
    cloud = PointCloud2(header=scan.header, height=1, width=len(points), point_step=12, row_step=12 * len(points))
    cloud.fields = [PointField(name, 4 * index, PointField.FLOAT32, 1) for index, name in enumerate("xyz")]
    cloud.data = points.tobytes()
    return cloud


def undated(scan):
    """Return a scan without a stamp."""
    scan.header.stamp = rospy.Time()
    return scan


class TestAmcl(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.room = synthetic_room()
        cls.map_service = rospy.Service(
            "static_map", GetMap, lambda _: GetMapResponse(map_to_message(cls.room, "map", rospy.get_rostime()))
        )
        cls.robot = RoomRobot(cls.room, START)
        cls.transforms = Transforms()
        cls.pose = Listener("amcl_pose", PoseWithCovarianceStamped, connected=True)
        cls.cloud = Listener("particlecloud", PoseArray, connected=True)
        cls.tf = Listener("/tf", TFMessage)
        cls.publisher = connected_publisher("initialpose", PoseWithCovarianceStamped)

    @classmethod
    def tearDownClass(cls):
        cls.robot.stop()

    def setUp(self):
        self.robot.velocity = (0.0, 0.0)
        self.robot.scanning = True
        self.robot.change_ranges = lambda ranges: ranges
        self.robot.change_message = lambda message: message

    def start_at(self, pose, **options):
        count = len(self.pose.messages)
        self.publisher.publish(initial_pose(pose, **options))
        return self.pose.wait_for(lambda _: True, "an estimate after an initial pose", since=count)

    def error(self):
        try:
            estimate = self.transforms.lookup("map", "base_footprint")
        except TransformError:
            return math.inf, math.inf
        return estimate.distance_to(self.robot.pose), abs(angle_between(estimate.theta, self.robot.pose.theta))

    def drive_until(self, condition, what, turn=0.6, timeout=25.0):
        self.robot.velocity = (0.15, turn)
        try:
            found = wait_until(condition, what, timeout)
        finally:
            self.robot.velocity = (0.0, 0.0)
        wait_until(self.is_told_where_it_stopped, "tf to tell where the robot has stopped")
        return found

    def is_told_where_it_stopped(self):
        """Return whether its odometry has arrived here: in each period it turns by 0.06."""
        told, robot = self.transforms.lookup("odom", "base_footprint"), self.robot.odom_pose
        return told.distance_to(robot) < 1e-6 and abs(angle_between(told.theta, robot.theta)) < 1e-6

    def map_to_odom(self):
        return [t for m in self.tf.messages for t in m.transforms if t.child_frame_id == "odom"]

    def test_pose_cloud_and_transform_follow_the_robot(self):
        first = self.start_at(self.robot.pose)
        self.assertEqual(first.header.frame_id, "map")
        poses = len(self.pose.messages)
        self.drive_until(lambda: len(self.pose.messages) > poses + 8, "eight updates while driving")
        position, heading = self.error()
        self.assertLess(position, 0.15)
        self.assertLess(heading, 0.1)
        estimate = self.pose.last
        covariance = np.array(estimate.pose.covariance).reshape(6, 6)
        self.assertTrue((np.diag(covariance)[[0, 1, 5]] > 0.0).all())
        self.assertEqual(self.cloud.last.header.frame_id, "map")
        self.assertGreaterEqual(len(self.cloud.last.poses), 100)
        particles = np.array([pose_from_message(pose) for pose in self.cloud.last.poses])
        self.assertLess(
            np.hypot(*(particles[:, :2].mean(axis=0) - (estimate.pose.pose.position.x, estimate.pose.pose.position.y))),
            0.5,
        )

    def test_the_transform_is_dated_ahead_at_every_scan_and_goes_on_without(self):
        self.start_at(self.robot.pose)
        scans, tolerance = Listener("scan", LaserScan), rospy.Duration(0.1)

        def dated_ahead():
            stamps = {scan.header.stamp + tolerance for scan in scans.messages}
            return sum(t.header.stamp in stamps for t in self.map_to_odom()) > 5

        wait_until(dated_ahead, "map -> odom dated ahead of scans while standing")
        scans.close()
        self.assertEqual(self.map_to_odom()[-1].header.frame_id, "map")
        self.robot.scanning = False
        silent = rospy.get_rostime() + rospy.Duration(1.0)
        wait_until(
            lambda: self.map_to_odom()[-1].header.stamp > silent + rospy.Duration(0.3), "map -> odom without scans"
        )

    def test_global_localization_finds_the_robot_from_a_wrong_belief(self):
        self.start_at(Pose2D(6.0, 3.0, 2.0))
        wait_until(lambda: 1.0 < self.error()[0] < math.inf, "a wrong belief")
        rospy.ServiceProxy("global_localization", Empty)()
        update = rospy.ServiceProxy("request_nomotion_update", Empty)
        self.robot.velocity = (0.15, 0.6)

        def found():
            update()
            return self.error()[0] < 0.25

        wait_until(found, "the robot to be found anywhere in the room", 40.0)

    def test_nomotion_update_updates_while_standing(self):
        self.start_at(self.robot.pose)
        count = len(self.pose.messages)
        rospy.ServiceProxy("request_nomotion_update", Empty)()
        self.pose.wait_for(lambda _: True, "an update without motion", since=count)

    def test_bad_initial_poses_are_refused_and_harm_nothing(self):
        self.start_at(self.robot.pose)
        wait_until(lambda: self.error()[0] < 0.3, "a good start")
        for bad in (
            initial_pose(Pose2D(math.nan, 0.0, 0.0)), initial_pose(Pose2D(200.0, 0.0, 0.0)),
            initial_pose(Pose2D(1.0, 1.0, 0.0), frame="odom"), initial_pose(Pose2D(1.0, 1.0, 0.0), variance=math.inf),
        ):
            self.publisher.publish(bad)
            count = len(self.map_to_odom())
            wait_until(lambda: len(self.map_to_odom()) > count + 2, "map -> odom after a bad initial pose")
        self.assertLess(self.error()[0], 0.3)

    def test_bad_scans_are_refused_and_harm_nothing(self):
        self.start_at(self.robot.pose)
        for change in (
            lambda ranges: np.full(len(ranges), np.nan), lambda ranges: np.full(len(ranges), np.inf),
            lambda ranges: ranges[:0], lambda ranges: ranges[:30], lambda ranges: np.zeros(len(ranges)),
        ):
            self.robot.change_ranges = change
            count = len(self.map_to_odom())
            wait_until(
                lambda: len(self.map_to_odom()) > count + 1 or change(np.ones(3)).size == 0,
                "map -> odom with bad scans",
            )
        self.robot.change_ranges = lambda ranges: ranges
        poses = len(self.pose.messages)
        self.drive_until(lambda: len(self.pose.messages) > poses + 4, "updates after bad scans")
        self.assertLess(self.error()[0], 0.3)

    def test_a_robot_whose_lidar_does_not_date_its_scans_is_followed(self):
        """map -> odom was dated 0 with them, and the server waited for a newer one for ever."""
        self.start_at(self.robot.pose)
        change, self.robot.change_message = self.robot.change_message, undated
        count, now = len(self.map_to_odom()), rospy.get_time()
        self.drive_until(
            lambda: sum(sent.header.stamp.to_sec() > now for sent in self.map_to_odom()[count:]) > 8,
            "transforms by undated scans")
        self.robot.change_message = change
        stamps = [sent.header.stamp.to_sec() for sent in self.map_to_odom()[count:]]
        self.assertGreater(min(stamps), now - 60.0)  # one by a scan of before may still come
        self.assertLess(self.error()[0], 0.3)

    def test_a_robot_whose_lidar_sends_point_clouds_is_followed(self):
        self.start_at(self.robot.pose)
        clouds = connected_publisher("cloud_in", PointCloud2)
        change, self.robot.change_message = self.robot.change_message, lambda message: clouds.publish(
            cloud_of(message)) or LaserScan()
        poses = len(self.pose.messages)
        self.drive_until(lambda: len(self.pose.messages) > poses + 8, "eight updates by clouds alone")
        self.robot.change_message = change
        self.assertLess(self.error()[0], 0.15)

    def test_a_scan_that_names_no_frame_does_not_end_localization(self):
        scans, others = Listener("scan", LaserScan, connected=True), connected_publisher("scan", LaserScan)
        self.addCleanup(others.unregister)  # not before the last has arrived
        scan = copy.deepcopy(scans.wait_for(lambda _: True, "a scan"))
        for scan.header.frame_id in ("laser\0", ""):
            others.publish(scan)
        poses = len(self.pose.messages)
        self.drive_until(lambda: len(self.pose.messages) > poses + 2, "updates after a scan without a frame")

    def test_a_robot_knows_where_it_is_beside_a_lidar_that_stands_in_the_world(self):
        """What that saw was taken for the robot's own, seen from where the map had lain when its first scan came."""
        self.start_at(self.robot.pose)
        others = connected_publisher("scan", LaserScan)
        poses = len(self.pose.messages)
        wrong = LaserScan(angle_increment=0.1, range_min=0.1, range_max=5.0, ranges=[1.0] * 62)

        def disturbed():
            wrong.header.frame_id, wrong.header.stamp = "map", rospy.get_rostime()
            others.publish(wrong)
            return len(self.pose.messages) > poses + 8

        self.drive_until(disturbed, "eight updates while another lidar sends")
        others.unregister()
        self.assertLess(self.error()[0], 0.15)

    def test_a_robot_whose_lidar_has_another_clock_is_looked_for_where_it_was_when_that_looked(self):
        """In each turn it was looked for, and found, where it had not been yet."""
        _, _, mount, upside_down = self.robot.lidars[0]
        now, diagnostics = rospy.get_rostime(), Listener("/diagnostics", DiagnosticArray)
        self.robot._static.sendTransform(
            [mounting(frame, mount, upside_down, "base_footprint", now) for frame in ("base_scan", "early_scan")])

        def early(scan):
            scan.header.frame_id, scan.header.stamp = "early_scan", scan.header.stamp - rospy.Duration(0.2)
            return scan

        def told():
            statuses = [s for message in diagnostics.messages[-5:] for s in message.status if s.name == "amcl: scans"]
            values = {value.key: value.value for status in statuses for value in status.values}
            return values.get("scans of early_scan are dated late by [s]", "unknown")

        def turning_to_and_fro():
            self.robot.velocity = (0.0, math.copysign(1.5, math.sin(5.0 * rospy.get_time())))
            return told() != "unknown" and abs(float(told()) + 0.2) < 0.03

        self.start_at(self.robot.pose)
        self.robot.change_message = early
        try:
            wait_until(turning_to_and_fro, lambda: f"the offset of a lidar's clock, which is -0.2, not {told()}", 40.0)
        finally:
            self.robot.velocity = (0.0, 0.0)
        poses = len(self.pose.messages)
        self.drive_until(lambda: len(self.pose.messages) > poses + 8, "eight updates by a lidar with another clock")
        self.assertLess(self.error()[0], 0.15)

    def test_a_robot_knows_where_it_is_after_its_lidar_was_said_to_sit_elsewhere(self):
        """It sat for good where it had been at the first scan."""
        frame, topic, mount, upside_down = self.robot.lidars[0]
        for moved in (Pose2D(0.2, 0.1, 1.0), mount):
            self.robot.lidars = ((frame, topic, moved, upside_down),)
            self.robot.announce()
            self.start_at(self.robot.pose)
            poses = len(self.pose.messages)
            self.drive_until(lambda: len(self.pose.messages) > poses + 8, "eight updates while driving")
            self.assertLess(self.error()[0], 0.15)
            self.assertLess(self.error()[1], 0.1)

    def test_set_map_takes_map_and_pose_and_refuses_an_empty_one(self):
        set_map = rospy.ServiceProxy("set_map", SetMap)
        message = map_to_message(self.room, "map", rospy.get_rostime())
        count = len(self.pose.messages)
        self.assertTrue(set_map(message, initial_pose(self.robot.pose)).success)
        self.pose.wait_for(lambda _: True, "an estimate on the new map", since=count)
        message.info.width = message.info.height = 0
        message.data = []
        self.assertFalse(set_map(message, initial_pose(self.robot.pose)).success)
        self.assertLess(self.error()[0], 0.4)

    def test_parameters_change_at_once(self):
        client = Client("amcl", timeout=20)
        try:
            client.update_configuration({"transform_tolerance": 1.5, "laser_model_type": "likelihood_field_prob"})
            self.start_at(self.robot.pose)
            now = rospy.get_rostime()
            wait_until(
                lambda: any(t.header.stamp > now + rospy.Duration(1.2) for t in self.map_to_odom()[-20:]),
                "map -> odom dated further ahead",
            )
            refused = client.update_configuration({"min_particles": 100000})
            self.assertLess(refused["min_particles"], 100000)
        finally:
            client.update_configuration({"restore_defaults": True})
        wait_until(
            lambda: client.get_configuration()["laser_model_type"] == "likelihood_field", "the defaults to be told"
        )

    def test_blocks_that_changed_are_told_to_who_listens(self):
        blocks = Listener("/amcl/changed_blocks", OccupancyGrid)
        self.start_at(self.robot.pose)
        self.drive_until(lambda: any(0 in m.data for m in blocks.messages), "a block that is as the map has it")
        message = blocks.messages[-1]
        self.assertEqual(message.header.frame_id, "map")
        self.assertEqual(message.info.resolution, 1.0)
        self.assertEqual(message.info.width * message.info.height, len(message.data))
        self.assertNotIn(100, message.data)

    def test_likelihood_and_effective_particles_are_told(self):
        likelihood = Listener("/amcl/log_likelihood", Float64)
        effective = Listener("/amcl/effective_sample_size", Float64)
        self.start_at(self.robot.pose)
        self.drive_until(lambda: likelihood.messages and effective.messages, "likelihood and effective particles")
        self.assertTrue(math.isfinite(likelihood.messages[-1].data))
        self.assertGreaterEqual(effective.messages[-1].data, 1.0)

    def test_the_pose_is_kept_on_the_parameter_server(self):
        self.start_at(self.robot.pose)
        wait_until(
            lambda: (
                abs(rospy.get_param("/amcl/initial_pose_x", 99.0) - self.robot.pose.x) < 0.4
                and abs(rospy.get_param("/amcl/initial_pose_y", 99.0) - self.robot.pose.y) < 0.4
            ),
            "the pose among the parameters",
        )
        self.assertGreater(rospy.get_param("/amcl/initial_cov_xx"), 0.0)

    def test_diagnostics_tell_the_deviations(self):
        diagnostics = Listener("/diagnostics", DiagnosticArray)
        message = diagnostics.wait_for(
            lambda m: any(s.name == "amcl: Standard deviation" for s in m.status), "diagnostics of amcl"
        )
        self.assertTrue({"std_x", "std_y", "std_yaw"} <= {value.key for value in message.status[0].values})

    def test_diagnostics_tell_how_well_the_scan_fits_the_map(self):
        diagnostics = Listener("/diagnostics", DiagnosticArray)

        def share(message):
            values = [v for status in message.status if status.name == "amcl: scans" for v in status.values]
            told = [v.value for v in values if v.key == "share of the scan on the map's walls [%]"]
            return float(told[0]) if told and told[0] != "unknown" else None

        self.start_at(self.robot.pose)
        diagnostics.wait_for(lambda m: (share(m) or 0.0) > 80.0, "a scan that fits")


if __name__ == "__main__":
    rospy.init_node("amcl_test")
    rostest.rosrun("mbf_relay", "amcl", TestAmcl)
