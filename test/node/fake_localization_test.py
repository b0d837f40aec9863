#!/usr/bin/env python3
"""The fake_localization node on topics: true poses of a paper simulator come out as amcl's would."""

import math
import os
import sys
import unittest

import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped, TransformStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from ros_testing import Listener, connected_publisher, wait_until  # noqa: E402

from mbf_relay.geometry import Pose2D, angle_between  # noqa: E402
from mbf_relay.ros.common.conversions import (  # noqa: E402
    header,
    pose_from_message,
    pose_to_message,
    transform_from_message,
    transform_to_message,
)

ODOM = Pose2D(0.4, -0.3, 0.5)
"""Where odometry has the robot, all the time."""


class TestFakeLocalization(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.poses = Listener("amcl_pose", PoseWithCovarianceStamped, connected=True)
        cls.clouds = Listener("particlecloud", PoseArray, connected=True)
        cls.transforms = Listener("/tf", TFMessage)
        cls.truth = connected_publisher("base_pose_ground_truth", Odometry)
        cls.initial_pose = connected_publisher("initialpose", PoseWithCovarianceStamped)
        cls.tf = connected_publisher("/tf", TFMessage)
        node = rospy.resolve_name("fake_localization")
        wait_until(lambda: node in cls.transforms.publishers, "a connection for map -> odom")
        cls.stamp = rospy.Time(0)

    def send(self, truth, odometry=True, **odd):
        """Publish where the simulator has the robot, and odometry of the same time; return that."""
        while rospy.get_rostime() <= self.stamp:
            pass
        stamp = type(self).stamp = rospy.get_rostime()
        message = Odometry(header=header("world", odd.get("stamp", stamp)))
        message.pose.pose = pose_to_message(truth)
        self.truth.publish(message)
        if odometry:
            self.tf.publish([TransformStamped(header("odom", stamp), "base_link", transform_to_message(ODOM))])
        return stamp

    def assert_near(self, pose, expected):
        self.assertLess(pose.distance_to(expected), 1e-6, (pose, expected))
        self.assertLess(abs(angle_between(pose.theta, expected.theta)), 1e-6, (pose, expected))

    def told(self, truth):
        """Return the pose told of a true pose, checked against transform and cloud of the same time."""
        stamp = self.send(truth)
        pose = self.poses.wait_for(lambda message: message.header.stamp == stamp, "the pose")
        self.assertEqual(pose.header.frame_id, "map")
        self.assertEqual(set(pose.pose.covariance), {0.0})
        cloud = self.clouds.wait_for(lambda message: message.header.stamp == stamp, "the cloud")
        self.assertEqual(cloud.poses, [pose.pose.pose])
        ahead = stamp + rospy.Duration.from_sec(0.25)

        def of_this_time(message):
            return [one for one in message.transforms if one.header.frame_id == "map" and one.header.stamp == ahead]

        found = of_this_time(self.transforms.wait_for(of_this_time, "map -> odom"))[0]
        self.assertEqual(found.child_frame_id, "odom")
        on_map = pose_from_message(pose.pose.pose)
        self.assert_near(transform_from_message(found.transform).compose(ODOM), on_map)
        return on_map

    def test_1_a_robot_in_a_simulator_is_where_the_map_has_that_place(self):
        """The map's origin is at (1, 2) along its own axes, turned by a right angle."""
        self.assert_near(self.told(Pose2D(0.0, 0.0, 0.0)), Pose2D(-1.0, -2.0, -math.pi / 2.0))
        self.assert_near(self.told(Pose2D(3.0, 0.0, 1.0)), Pose2D(-1.0, -5.0, 1.0 - math.pi / 2.0))

    def test_2_a_pose_set_in_rviz_is_where_it_is_from_then_on(self):
        self.told(Pose2D(3.0, 0.0, 1.0))
        told_before = len(self.poses.messages)
        chosen = PoseWithCovarianceStamped(header=header("map", rospy.get_rostime()))
        chosen.pose.pose = pose_to_message(Pose2D(7.0, 8.0, 0.0))
        self.initial_pose.publish(chosen)
        wait_until(lambda: self.told(Pose2D(3.0, 0.0, 1.0)).distance_to(Pose2D(7.0, 8.0, 0.0)) < 1e-6, "the new pose")
        self.assert_near(self.told(Pose2D(3.0, 0.0, 2.0)), Pose2D(7.0, 8.0, 1.0))
        self.assertGreater(len(self.poses.messages), told_before)

    def test_3_what_means_nothing_is_not_told_and_the_next_true_pose_is(self):
        expected = self.told(Pose2D(3.0, 0.0, 1.0))
        since = len(self.poses.messages), len(self.transforms.messages)
        self.send(Pose2D(math.nan, 0.0, 0.0))
        self.send(Pose2D(1e30, 0.0, 0.0))
        self.send(Pose2D(1.0, 1.0, 0.0), stamp=rospy.Time(2 ** 32 - 1, 0))
        self.send(Pose2D(1.0, 1.0, 0.0), stamp=rospy.get_rostime() + rospy.Duration(1000.0))
        for frame, pose in (("elsewhere", Pose2D(1.0, 1.0, 0.0)), ("map", Pose2D(math.inf, 0.0, 0.0))):
            chosen = PoseWithCovarianceStamped(header=header(frame, rospy.get_rostime()))
            chosen.pose.pose = pose_to_message(pose)
            self.initial_pose.publish(chosen)
        for _ in range(3):  # initial poses come by another way: they are there by the second
            self.assert_near(self.told(Pose2D(3.0, 0.0, 1.0)), expected)
        self.assertEqual({message.header.stamp <= self.stamp for message in self.poses.messages[since[0]:]}, {True})
        for message in self.transforms.messages[since[1]:]:
            for one in message.transforms:
                self.assertTrue(transform_from_message(one.transform).is_finite())

    def test_4_a_true_pose_waits_for_its_odometry_and_is_told_without_another(self):
        stamp = self.send(Pose2D(3.0, 0.0, 1.0), odometry=False)
        self.tf.publish([TransformStamped(header("odom", stamp), "base_link", transform_to_message(ODOM))])
        self.poses.wait_for(lambda message: message.header.stamp == stamp, "the pose that waited")

    def test_5_a_simulator_that_says_no_more_is_an_error_by_name(self):
        diagnostics = Listener("/diagnostics", DiagnosticArray)

        def is_said(message):
            return any("no true pose comes on" in status.message and status.message.endswith("/base_pose_ground_truth")
                       and status.level == 2 for status in message.status)

        diagnostics.wait_for(is_said, "the error")
        diagnostics.close()


if __name__ == "__main__":
    rospy.init_node("fake_localization_test")
    rostest.rosrun("mbf_relay", "fake_localization_test", TestFakeLocalization)
