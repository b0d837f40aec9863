#!/usr/bin/env python3
"""The guard between a driver and the simulated wheels: what passes, what stops the robot, and what it says of it."""

import copy
import itertools
import os
import sys
import unittest

import numpy as np
import rosnode
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import Point32, Polygon, Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import LaserScan
from std_msgs.msg import String
from std_srvs.srv import Empty
from visualization_msgs.msg import Marker, MarkerArray

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from ros_testing import Listener, connected_publisher, wait_until  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.ros.common.conversions import header, pose_from_message, pose_to_message  # noqa: E402

NO_FAULTS = {"lidar_silent": False, "lidar_frozen": False, "dead_beams": 0.0, "dead_beams_start": 0.0}
STILL = Twist()


def forward(speed):
    message = Twist()
    message.linear.x = speed
    return message


class TestVelocityGuard(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scans = Listener("scan", LaserScan, connected=True)
        cls.truth = Listener("ground_truth", Odometry, connected=True)
        cls.contacts = Listener("contacts", MarkerArray, connected=True)
        cls.passed = Listener("cmd_vel", Twist, connected=True)
        cls.states = Listener("velocity_guard/state", String, connected=True)
        cls.diagnostics = Listener("/diagnostics", DiagnosticArray, connected=True)
        cls.set_obstacles = connected_publisher("simulator/set_obstacles", MarkerArray)
        cls.faults = Client("simulator/faults", timeout=30.0)
        cls.reset = staticmethod(rospy.ServiceProxy("simulator/reset", Empty))

    def setUp(self):
        self.faults.update_configuration(NO_FAULTS)
        wait_until(self.stays_where_it_is_put, "the robot to stand at its start")
        self.drive = connected_publisher("cmd_vel_raw", Twist)
        known = len(self.scans.messages)
        wait_until(lambda: len(self.scans.messages) > known, "a scan")

    def tearDown(self):
        self.drive.unregister()
        self.set_obstacles.publish([Marker(action=Marker.DELETEALL)])

    def stays_where_it_is_put(self):
        """Put the robot back; return whether a velocity of the test before, or its end, does not move it on."""
        self.reset()
        known = len(self.truth.messages)
        wait_until(lambda: len(self.truth.messages) > known + 5, "where the robot is")
        return abs(self.x() + 2.0) < 0.005

    def x(self):
        return pose_from_message(self.truth.last.pose.pose).x

    def drive_until(self, condition, what, speed=0.2):
        """Ask for a velocity, again and again, until the condition holds."""

        def driving():
            self.drive.publish(forward(speed))
            return condition()

        return wait_until(driving, what, period=0.02)

    def start_driving(self):
        """Drive until the robot moves and what passes is what is asked for: what comes late stops it meanwhile."""
        start = self.x()

        def drives():
            self.known_states = len(self.states.messages)  # noted first: what ends the drive may be told any moment
            return self.x() > start + 0.02 and self.passed.last == forward(0.2)

        self.drive_until(drives, "the robot to drive")

    def check_state(self, words):
        """Check that the guard says so of what has happened since the robot drove."""
        self.states.wait_for(lambda m: words in m.data, f"'{words}'", since=self.known_states)

    def drive_until_stopped_for(self, words):
        """Ask for the velocity until the guard stops the robot, and says why."""
        self.drive_until(
            lambda: self.passed.last == STILL and words in self.states.last.data and
            len(self.states.messages) > self.known_states,
            lambda: f"the robot to be stopped with '{words}', not '{self.states.last.data}'")

    def test_a_velocity_passes_as_it_is_and_a_stop_passes(self):
        self.start_driving()
        self.drive.publish(STILL)
        wait_until(lambda: self.passed.last == STILL, "the zero")
        wait_until(lambda: self.states.last.data.startswith("standing"), "the guard to say that the robot stands")

    def put_box(self):
        """Put a box before the robot, its front 0.35 m away, and wait until the lidar sees it."""
        box = Marker(
            header=header("map", 0.0),
            ns="test",
            type=Marker.CUBE,
            action=Marker.ADD,
            pose=pose_to_message(Pose2D(-1.5, -0.5, 0.0)),
        )
        box.scale.x = box.scale.y = box.scale.z = 0.3
        box.pose.position.z = 0.15  # up to where the lidar sees it
        since = len(self.scans.messages)
        self.set_obstacles.publish([box])
        self.scans.wait_for(lambda scan: scan.ranges[0] < 0.5, "the box", since=since)

    def test_a_box_in_the_way_is_not_touched_and_may_be_backed_away_from(self):
        self.put_box()
        self.start_driving()
        self.drive_until(lambda: self.passed.last == STILL, "the robot to be stopped")
        self.drive_until(lambda: self.states.last.data.startswith("stopped: something at"), "the reason")
        self.assertEqual([m for message in self.contacts.messages for m in message.markers if m.action == m.ADD], [])
        stopped_at = self.x()
        self.assertGreater(stopped_at, -1.8, "it may come near")
        self.drive_until(lambda: self.x() < stopped_at - 0.1, "the robot to back away", speed=-0.2)
        status = DiagnosticStatus.WARN
        self.drive_until(lambda: self.passed.last == STILL, "the robot to be stopped again")
        self.drive_until(lambda: self.guards_report(status, "something at"), "a warning in diagnostics")

    def test_a_robot_that_takes_up_a_load_keeps_it_off_the_box(self):
        """Its costmaps were told of it, and the guard went on by the robot alone."""
        footprints = connected_publisher("velocity_guard/footprint", Polygon)
        self.addCleanup(footprints.unregister)  # not before the last has arrived

        def reaches(front):
            corners = ((-0.105, -0.105), (-0.105, 0.105), (front, 0.105), (front, -0.105))
            footprints.publish(Polygon([Point32(x, y, 0.0) for x, y in corners]))

        try:
            reaches(0.3)
            self.put_box()
            self.drive_until(lambda: self.states.last.data.startswith("stopped: something at"), "the robot to stop")
            self.assertLess(self.x(), -1.65 - 0.3, "its load, 0.3 m before it, is off the box")
            reaches(float("nan"))
            footprints.publish(Polygon())
        finally:
            reaches(0.041)
        start = self.x()
        self.drive_until(lambda: self.x() > start + 0.1, "the robot to drive on without its load")

    def guards_report(self, level, words):
        statuses = [s for m in self.diagnostics.messages[-5:] for s in m.status if s.name.startswith("velocity_guard")]
        return any(status.level == level and words in status.message for status in statuses)

    def test_without_scans_the_robot_stands(self):
        self.start_driving()
        self.faults.update_configuration({"lidar_silent": True})
        self.drive_until_stopped_for("the newest scan is")
        self.faults.update_configuration(NO_FAULTS)
        self.start_driving()

    def test_a_lidar_that_repeats_itself_stops_the_robot(self):
        self.start_driving()
        self.faults.update_configuration({"lidar_frozen": True})
        self.drive_until_stopped_for("the newest scan is")

    def test_a_lidar_that_is_blind_ahead_stops_the_robot(self):
        self.start_driving()
        self.faults.update_configuration({"dead_beams": 0.3, "dead_beams_start": -1.0})
        blinded_at = self.x()
        self.drive_until_stopped_for("stopped: something at")
        self.assertLess(self.x(), blinded_at + 0.3, "long before the next wall")

    def test_a_driver_that_falls_silent_leaves_the_robot_standing(self):
        self.start_driving()
        wait_until(lambda: self.passed.last == STILL, "a zero after the last velocity")
        self.check_state("no velocity has come")

    def test_a_driver_that_dies_leaves_the_robot_standing(self):
        self.start_driving()
        self.drive.unregister()
        wait_until(lambda: self.passed.last == STILL, "a zero after the last velocity")
        self.check_state("no velocity has come")

    def test_what_is_no_number_is_a_stop(self):
        self.start_driving()
        self.drive.publish(forward(float("nan")))
        wait_until(lambda: self.passed.last == STILL, "a zero")
        self.check_state("not finite")

    def test_a_scan_that_names_no_frame_does_not_end_the_guard(self):
        scan, others = copy.deepcopy(self.scans.last), connected_publisher("scan", LaserScan)
        self.addCleanup(others.unregister)  # not before the last has arrived
        for scan.header.frame_id in ("base_scan\0", ""):
            others.publish(scan)
        self.start_driving()

    def test_a_lidar_that_dates_nothing_lets_the_robot_drive(self):
        scan, others = copy.deepcopy(self.scans.last), connected_publisher("scan", LaserScan)
        self.faults.update_configuration({"lidar_silent": True})
        ranges, turn = np.array(scan.ranges), itertools.count()

        def driven():
            scan.header.stamp = rospy.Time()
            scan.ranges = (ranges + 0.001 * (next(turn) % 7)).tolist()  # never twice the same
            others.publish(scan)
            return self.x() > -2.0 + 0.4

        try:
            self.drive_until(driven, "the robot to be driven by scans that have no date")
        finally:
            others.unregister()

    def test_a_lidar_that_nobody_placed_beside_one_that_works_is_named(self):
        scan, others = copy.deepcopy(self.scans.last), connected_publisher("scan", LaserScan)

        def warned():
            for scan.header.frame_id in ("nobody_placed", "nor_this"):
                scan.header.stamp = rospy.get_rostime()
                others.publish(scan)
            return all(self.guards_report(DiagnosticStatus.WARN, frame) for frame in ("nobody_placed", "nor_this"))

        try:
            self.drive_until(warned, "a warning that names both lidars, while the robot drives", speed=0.02)
        finally:
            others.unregister()
        self.drive_until(lambda: self.guards_report(DiagnosticStatus.OK, "passing"), "the all-clear", speed=0.02)

    def test_a_guard_that_nobody_asks_does_not_look_like_one_that_guards(self):
        self.drive.unregister()
        said = "nobody publishes on /cmd_vel_raw"
        wait_until(lambda: self.guards_report(DiagnosticStatus.WARN, said), "the guard to say so")

    def test_z_a_guard_that_ends_sends_a_zero_first(self):
        self.start_driving()
        rosnode.kill_nodes(["/velocity_guard"])
        self.drive_until(lambda: self.passed.last == STILL, "a zero as the last word")


if __name__ == "__main__":
    rospy.init_node("velocity_guard_test")
    wait_until(lambda: rospy.get_time() != 0.0, "/clock", 60.0)
    rostest.rosrun("mbf_relay", "velocity_guard", TestVelocityGuard)
