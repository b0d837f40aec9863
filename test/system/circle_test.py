#!/usr/bin/env python3
"""The tutorial's circle, driven with the tutorial's launch files and clients; with ~pillars_off on a poorer map."""

import os
import sys
import unittest

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.srv import GetMap, SetMap
from std_msgs.msg import Float64

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from ros_testing import Listener  # noqa: E402
from running_stack import Witness, run_client, start_test_node  # noqa: E402

from mbf_relay.ros.common.conversions import header, map_from_message, map_to_message, pose_to_message  # noqa: E402
from mbf_relay.ros.tools.clients import CIRCLE  # noqa: E402
from mbf_relay.simulation.arena import PILLAR_RADIUS  # noqa: E402

NEAR = 0.15
"""Metres: the goal tolerance of the parameter file, 0.05, and what localization may be off."""

PILLARS_OFF = ((-1.1, 1.1), (1.1, 0.0), (0.0, -1.1))
"""A third of the arena's pillars: x, y (m)."""
OFF_THE_MAP = 0.1
"""Metres from the truth that localization may be while they are not on its map."""


class TestCircle(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.witness = Witness()

    def take_pillars_off(self, witness, estimates, reliabilities):
        """Give amcl a map without them, as if they had been put up since; return how often it had told its pose."""
        for listener in (estimates, reliabilities):
            listener.wait_for(lambda _: True, "what amcl told at its start")
        count = len(estimates.messages)
        occupancy = map_from_message(rospy.ServiceProxy("static_map", GetMap)().map)
        rows, columns = np.nonzero(occupancy.data > 0)
        centres = np.column_stack((columns, rows)) + 0.5
        points = occupancy.origin.transform_points(centres * occupancy.resolution)
        for x, y in PILLARS_OFF:
            near = np.hypot(points[:, 0] - x, points[:, 1] - y) < 2.0 * PILLAR_RADIUS
            self.assertGreater(np.count_nonzero(near), 10, f"cells of the pillar at ({x}, {y}) on the map")
            occupancy.data[rows[near], columns[near]] = 0
        pose = PoseWithCovarianceStamped(header=header("map", rospy.get_rostime()))
        pose.pose.pose = pose_to_message(witness.pose)
        pose.pose.covariance = (0.01 * np.eye(6)).ravel().tolist()
        message = map_to_message(occupancy, "map", rospy.get_rostime())
        self.assertTrue(rospy.ServiceProxy("set_map", SetMap)(message, pose).success)
        estimates.wait_for(lambda _: True, "an estimate on the poorer map", since=count)
        reliabilities.wait_for(lambda _: True, "its reliability", since=count)
        return count

    def assert_localized(self, witness, estimates, reliabilities):
        times, x, y, _ = witness.trajectory.T
        self.assertGreater(len(estimates), 20, "estimates on the way")
        for message in estimates:
            stamp, position = message.header.stamp.to_sec(), message.pose.pose.position
            off = np.hypot(np.interp(stamp, times, x) - position.x, np.interp(stamp, times, y) - position.y)
            self.assertLess(off, OFF_THE_MAP, f"estimate of {stamp:.1f} s")
        self.assertGreater(min(message.data for message in reliabilities), 0.5, "a right pose was doubted")

    def drive(self, client):
        witness = self.witness
        witness.forget()
        poorer = rospy.get_param("~pillars_off", False)
        if poorer:
            estimates = Listener("amcl_pose", PoseWithCovarianceStamped, connected=True)
            reliabilities = Listener("amcl/reliability", Float64, connected=True)
            before = self.take_pillars_off(witness, estimates, reliabilities)
        run = run_client(client)
        self.assertIn("Drove circle with result: True", run.output)
        self.assertEqual(run.status, 0, run.output)
        for x, y, _, _ in CIRCLE:
            self.assertLess(witness.way_to(x, y), NEAR, f"goal ({x}, {y}) of {client}")
        self.assertEqual(witness.touched(), [])
        self.assertEqual(witness.warnings(), [])
        if poorer:
            self.assert_localized(witness, estimates.messages[before:], reliabilities.messages[before:])


def _test_of(client):
    def test(self):
        self.drive(client)

    return test


if __name__ == "__main__":
    start_test_node("circle_test")
    for _client in rospy.get_param("~clients", ["mb_relay_client.py"]):  # each leaves the robot where it found it
        setattr(TestCircle, f"test_{os.path.splitext(_client)[0]}_drives_the_circle", _test_of(_client))
    rostest.rosrun("mbf_relay", "circle", TestCircle)
