#!/usr/bin/env python3
"""The simulator node: its topics, services, obstacles, faults, and what bad input leaves unharmed."""

import math
import os
import sys
import unittest

import rospy
import rosservice
import rostest
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import PoseStamped, Twist
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState, LaserScan
from std_srvs.srv import Empty, Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from ros_testing import Listener, connected_publisher, wait_until  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.ros.common.conversions import header, pose_from_message, pose_to_message  # noqa: E402

START = Pose2D(-2.0, -0.5, 0.0)
NO_FAULTS = {
    "lidar_silent": False,
    "lidar_frozen": False,
    "dead_beams": 0.0,
    "dead_beams_start": 0.0,
    "short_readings": 0.0,
    "odom_silent": False,
    "odom_frozen": False,
    "odom_delay": 0.0,
    "odom_jump": 0.0,
    "slip": 0.0,
    "command_delay": 0.0,
}


def twist(x, theta=0.0):
    message = Twist()
    message.linear.x, message.angular.z = x, theta
    return message


def marker(
    number, kind=Marker.CYLINDER, x=-1.5, y=-0.5, size=(0.2, 0.2, 0.5), action=Marker.ADD, frame="map", lifetime=0.0
):
    message = Marker(header=header(frame, 0.0), ns="test", id=number, type=kind, action=action)
    message.pose = pose_to_message(Pose2D(x, y, 0.0))
    message.pose.position.z = size[2] / 2.0
    message.scale.x, message.scale.y, message.scale.z = size
    message.lifetime = rospy.Duration(lifetime)
    return message


def turned(message):
    """Return a marker whose orientation is none."""
    message.pose.orientation.z = math.nan
    return message


class TestSimulator(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scans = Listener("scan", LaserScan, connected=True)
        cls.odoms = Listener("odom", Odometry, connected=True)
        cls.truths = Listener("ground_truth", Odometry, connected=True)
        cls.clocks = Listener("/clock", Clock, connected=True)
        cls.contacts = Listener("contacts", MarkerArray, connected=True)
        cls.standing = Listener("simulator/obstacles", MarkerArray, connected=True)
        cls.drive = connected_publisher("cmd_vel", Twist)
        cls.set_pose = connected_publisher("simulator/set_pose", PoseStamped)
        cls.set_obstacles = connected_publisher("simulator/set_obstacles", MarkerArray, queue_size=1000)
        for name in ("reset", "pause", "unpause"):
            rospy.wait_for_service(f"simulator/{name}", 30.0)
            setattr(cls, name, staticmethod(rospy.ServiceProxy(f"simulator/{name}", Empty)))
        cls.step = staticmethod(rospy.ServiceProxy("simulator/step", Trigger))
        cls.faults = Client("simulator/faults", timeout=30.0)

    def setUp(self):
        self.faults.update_configuration(NO_FAULTS)
        # Commands of the test before may still be on their way; they end half a second after the last.
        self.fresh(self.truths, 20)
        wait_until(lambda: self.reset() and self.true_pose().distance_to(START) < 0.01, "the robot at its start")
        self.fresh(self.scans)

    def fresh(self, listener, count=1):
        """Return the message that comes `count` messages from now."""
        known = len(listener.messages)
        wait_until(lambda: len(listener.messages) >= known + count, f"{count} more messages on {listener.topic}")
        return listener.messages[known + count - 1]

    def spacing(self, listener):
        """Return the time (s) between two readings that come one after another."""
        known = len(listener.messages)
        self.fresh(listener, 2)
        first, second = listener.messages[known:known + 2]
        return (second.header.stamp - first.header.stamp).to_sec()

    def true_pose(self):
        return pose_from_message(self.fresh(self.truths, 2).pose.pose)

    def odometry(self):
        """Return where odometry has the robot at the newest true pose, or later; it may be heard later than that."""
        stamp = self.truths.last.header.stamp
        wait_until(lambda: self.odoms.last.header.stamp >= stamp, "odometry of now")
        return self.odoms.last.pose.pose.position

    def drive_until(self, condition, what, x=0.2, theta=0.0):
        """Send a velocity, again and again, until the condition holds."""

        def driving():
            self.drive.publish(twist(x, theta))
            return condition()

        return wait_until(driving, what, period=0.01)

    def test_readings_come_in_their_frames_and_rates(self):
        scan = self.fresh(self.scans)
        self.assertEqual((scan.header.frame_id, len(scan.ranges)), ("base_scan", 360))
        self.assertAlmostEqual(scan.angle_max, 2.0 * math.pi * 359 / 360, places=5)
        self.assertAlmostEqual(self.spacing(self.scans), 0.2, places=6)
        # The pillar at (-1.1, 0) stands a good metre off, ahead to the left of the lidar at x = -2.032.
        x, y = -1.1 + 2.032, 0.5
        beam = round(math.degrees(math.atan2(y, x)))
        self.assertAlmostEqual(scan.ranges[beam], math.hypot(x, y) - 0.15, delta=0.06)
        odom = self.fresh(self.odoms)
        self.assertEqual((odom.header.frame_id, odom.child_frame_id), ("odom", "base_footprint"))
        self.assertGreater(odom.pose.covariance[0], 0.0)
        self.assertGreater(odom.twist.covariance[35], 0.0)
        self.assertAlmostEqual(self.spacing(self.odoms), 1.0 / 30.0, places=6)
        imu = self.fresh(Listener("imu", Imu, connected=True))
        self.assertEqual(imu.header.frame_id, "imu_link")
        self.assertAlmostEqual(imu.linear_acceleration.z, 9.81, delta=0.2)
        joints = self.fresh(Listener("joint_states", JointState, connected=True))
        self.assertEqual(joints.name, ["wheel_left_joint", "wheel_right_joint"])
        transforms = Listener("/tf", TFMessage, connected=True)
        found = transforms.wait_for(lambda m: m.transforms[0].child_frame_id == "base_footprint", "odometry")
        self.assertEqual(found.transforms[0].header.frame_id, "odom")
        self.assertGreater(self.clocks.messages[0].clock.to_sec(), 0.0)

    def test_drives_and_stops_when_commands_end(self):
        self.drive_until(lambda: self.truths.last.pose.pose.position.x > START.x + 0.3, "the robot to drive 0.3 m")
        moving = self.truths.last
        self.assertAlmostEqual(moving.twist.twist.linear.x, 0.2, delta=0.02)
        wait_until(lambda: abs(self.truths.last.twist.twist.linear.x) < 1e-3, "the robot to stop by itself")
        went = self.true_pose().x - START.x
        self.assertAlmostEqual(self.odometry().x, went, delta=0.05)

    def test_commands_without_meaning_are_refused(self):
        for bad in (twist(math.nan), twist(0.1, math.inf)):
            for _ in range(3):
                self.drive.publish(bad)
        self.fresh(self.truths, 5)
        self.assertLess(self.true_pose().distance_to(START), 1e-3)

    def test_pause_step_and_unpause(self):
        self.assertFalse(self.step().success)
        self.pause()

        def stands():
            """Return the time that is told twice; what was told before the pause may still be on its way."""
            known = len(self.clocks.messages)
            self.fresh(self.clocks, 2)
            first, second = (message.clock for message in self.clocks.messages[known:known + 2])
            return first if first == second else None

        before = wait_until(stands, "time to stand")
        self.assertTrue(self.step().success)
        stepped = self.clocks.wait_for(
            lambda m: m.clock > before, "a later time", since=len(self.clocks.messages) - 1
        ).clock
        self.assertAlmostEqual((stepped - before).to_sec(), 1.0 / 60.0, places=6)
        self.unpause()
        wait_until(lambda: (self.clocks.last.clock - before).to_sec() > 0.5, "time to go on")

    def test_reset_brings_the_robot_and_its_odometry_back(self):
        self.drive_until(
            lambda: self.truths.last.pose.pose.position.x > START.x + 0.3, "the robot to drive 0.3 m", theta=0.3
        )
        now = self.clocks.last.clock
        self.reset()
        self.fresh(self.truths)
        # A command that was on its way when reset was called still moves the robot, for half a second at most.
        wait_until(lambda: abs(self.truths.last.twist.twist.linear.x) < 1e-3, "the robot to stand")
        self.assertLess(self.true_pose().distance_to(START), 0.15)
        place = self.odometry()
        self.assertLess(math.hypot(place.x, place.y), 0.15)
        self.reset()  # with none on its way; what was told before may be
        wait_until(lambda: self.true_pose().distance_to(START) < 0.05, "the robot at its start")
        wait_until(lambda: math.hypot(self.odometry().x, self.odometry().y) < 0.05, "its odometry to begin anew")
        self.assertGreaterEqual(self.clocks.last.clock, now)

    def test_set_down_elsewhere_odometry_does_not_notice(self):
        message = PoseStamped(header("map", 0.0), pose_to_message(Pose2D(0.5, 0.6, 1.0)))
        self.set_pose.publish(message)
        wait_until(
            lambda: self.true_pose().distance_to(Pose2D(0.5, 0.6, 1.0)) < 1e-3, "the robot to be set down elsewhere"
        )
        self.assertAlmostEqual(self.true_pose().theta, 1.0, places=3)
        self.assertAlmostEqual(self.fresh(self.odoms).pose.pose.position.x, 0.0, places=3)
        in_pillar = PoseStamped(header("map", 0.0), pose_to_message(Pose2D(0.0, 0.0, 0.0)))
        in_odom = PoseStamped(header("odom", 0.0), pose_to_message(Pose2D(0.3, 0.6, 0.0)))
        nowhere = PoseStamped(header("map", 0.0), pose_to_message(Pose2D(math.nan, 0.0, 0.0)))
        far = PoseStamped(header("map", 0.0), pose_to_message(Pose2D(1e6, 0.0, 0.0)))
        for refused in (in_pillar, in_odom, nowhere, far):
            self.set_pose.publish(refused)
        self.fresh(self.truths, 8)
        self.assertLess(self.true_pose().distance_to(Pose2D(0.5, 0.6, 1.0)), 1e-3)

    def ahead(self):
        return self.fresh(self.scans, 2).ranges[0]

    def test_obstacles_come_move_and_go(self):
        self.assertGreater(self.ahead(), 1.0)
        self.set_obstacles.publish(MarkerArray([marker(1)]))
        # From the lidar at x = -2.032 to the near side at -1.6.
        wait_until(lambda: abs(self.ahead() - 0.432) < 0.05, "the lidar to see the obstacle")
        self.set_obstacles.publish(MarkerArray([marker(1, x=-1.2)]))
        wait_until(lambda: abs(self.ahead() - 0.732) < 0.05, "the lidar to see it moved")
        wait_until(lambda: [(m.ns, m.id) for m in self.standing.last.markers[1:]] == [("test", 1)], "it, told once")
        self.set_obstacles.publish(MarkerArray([marker(1, action=Marker.DELETE)]))
        wait_until(lambda: self.ahead() > 1.0, "the obstacle to be gone")
        self.set_obstacles.publish(MarkerArray([
            marker(2, Marker.CUBE, lifetime=0.6), marker(3, Marker.SPHERE, x=-1.0, y=0.6, size=(0.4, 0.4, 0.4)),
        ]))
        self.standing.wait_for(lambda m: len(m.markers) == 3, "both obstacles")
        self.standing.wait_for(lambda m: [x.id for x in m.markers[1:]] == [3], "the first one to outlive its lifetime")
        self.set_obstacles.publish(MarkerArray([marker(0, action=Marker.DELETEALL)]))
        wait_until(lambda: len(self.standing.last.markers) == 1, "every obstacle to be gone")

    def test_of_obstacles_that_a_program_sends_one_by_one_all_stand(self):
        """Of those that came at once rospy kept the last hundred, and the world lacked the others."""
        for number in range(250):
            self.set_obstacles.publish(MarkerArray([marker(number, x=3.0 + 0.3 * number)]))
        self.standing.wait_for(lambda m: any(each.id == 249 for each in m.markers), "the last one")
        stood = len(self.standing.last.markers)
        self.set_obstacles.publish(MarkerArray([marker(0, action=Marker.DELETEALL)]))
        wait_until(lambda: len(self.standing.last.markers) == 1, "every obstacle to be gone")
        self.assertEqual(stood, 1 + 250)

    def test_obstacles_without_meaning_are_refused_one_by_one(self):
        self.set_obstacles.publish(
            MarkerArray(
                [
                    marker(1, size=(0.0, 0.2, 0.5)),
                    marker(2, x=math.nan),
                    marker(3, kind=Marker.ARROW),
                    marker(4, frame="odom"),
                    marker(5, size=(0.2, 0.3, 0.5)),
                    marker(6, action=7),
                    marker(7, x=START.x, y=START.y),
                    marker(8),
                    marker(9, x=1e10),
                    marker(10, size=(1e10, 1e10, 1.0)),
                    marker(11, size=(1e-9, 1e-9, 1e-9)),
                    turned(marker(12)),
                ]
            )
        )
        wait_until(lambda: [m.id for m in self.standing.last.markers[1:]] == [8], "only the sound one to stand")

    def test_touching_is_told_with_place_and_name(self):
        self.set_obstacles.publish(MarkerArray([marker(1, Marker.CUBE, x=-1.7)]))
        self.standing.wait_for(lambda m: len(m.markers) == 2, "the obstacle", since=len(self.standing.messages) - 1)
        known = len(self.contacts.messages)
        self.drive_until(lambda: len(self.contacts.messages) > known, "a contact")
        touch = self.contacts.messages[known].markers[0]
        self.assertEqual(touch.text, "test/1")
        self.assertAlmostEqual(touch.pose.position.x, -1.8, delta=0.03)
        for _ in range(20):
            self.drive.publish(twist(0.2))
            self.fresh(self.truths)
        self.assertLess(self.true_pose().x, -1.8)

    def wait_for_silence(self, silent, other, count):
        """Wait until nothing comes on one topic while `count` messages come on another.

        What was sent before may be heard late.
        """

        def is_silent():
            known = len(silent.messages)
            self.fresh(other, count)
            return len(silent.messages) == known

        wait_until(is_silent, f"nothing more on {silent.topic}")

    def test_fault_lidar_silent(self):
        self.faults.update_configuration({"lidar_silent": True})
        self.wait_for_silence(self.scans, self.odoms, 30)  # in which five scans would come
        self.faults.update_configuration({"lidar_silent": False})
        self.fresh(self.scans)

    def test_fault_lidar_frozen(self):
        self.faults.update_configuration({"lidar_frozen": True})
        wait_until(
            lambda: self.fresh(self.scans).ranges == self.fresh(self.scans).ranges, "a scan that comes a second time")
        first, second = self.fresh(self.scans), self.fresh(self.scans)
        self.assertEqual(first.ranges, second.ranges)
        self.assertGreater(second.header.stamp, first.header.stamp)

    def test_fault_dead_beams(self):
        self.faults.update_configuration({"dead_beams": 0.25, "dead_beams_start": math.pi / 2.0})
        ranges = self.scans.wait_for(
            lambda m: set(m.ranges[90:180]) == {0.0}, "dead beams", since=len(self.scans.messages)).ranges
        self.assertTrue(all(reading > 0.12 for reading in ranges[:90] + ranges[180:]))

    def test_fault_odometry_silent(self):
        self.faults.update_configuration({"odom_silent": True})
        self.wait_for_silence(self.odoms, self.scans, 3)

    def test_fault_slip(self):
        self.faults.update_configuration({"slip": 0.5})
        self.drive_until(lambda: self.odoms.last.pose.pose.position.x > 0.3, "odometry to tell of 0.3 m")
        wait_until(lambda: abs(self.truths.last.twist.twist.linear.x) < 1e-3, "the robot to stop by itself")
        went = self.true_pose().x - START.x
        self.assertAlmostEqual(went, 0.5 * self.odometry().x, delta=0.03)

    def test_fault_command_delay(self):
        self.faults.update_configuration({"command_delay": 1.0})
        self.fresh(self.clocks)
        sent = self.clocks.last.clock
        moved = self.drive_until(
            lambda: [
                m
                for m in self.truths.messages[-50:]
                if m.header.stamp > sent and m.pose.pose.position.x > START.x + 0.002
            ],
            "the delayed command to show",
        )
        self.assertGreater((moved[0].header.stamp - sent).to_sec(), 1.0)

    def test_pictures(self):
        answer = rospy.ServiceProxy("simulator/take_pictures", Trigger)()
        self.assertTrue(answer.success, answer.message)
        for path in answer.message.split(os.pathsep):
            with open(path, "rb") as file:
                self.assertEqual(file.read(4), b"\x89PNG")

    def test_diagnostics_tell_the_factor(self):
        def factor(message):
            for status in message.status:
                if status.name == "simulator: simulation":
                    values = {pair.key: pair.value for pair in status.values}
                    return values["real time factor"] != "unknown" and values["real time factor asked for"] == "4"
            return False

        Listener("/diagnostics", DiagnosticArray, connected=True).wait_for(factor, "the real time factor")

    def test_services_are_all_there(self):
        names = {name for name in rosservice.get_service_list() if name.startswith("/simulator/")}
        for name in ("reset", "pause", "unpause", "step", "take_pictures", "faults/set_parameters"):
            self.assertIn(f"/simulator/{name}", names)


if __name__ == "__main__":
    rospy.init_node("simulator_test")
    rostest.rosrun("mbf_relay", "simulator_test", TestSimulator)
