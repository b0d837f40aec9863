#!/usr/bin/env python3
"""The tutorial's circle, driven with the tutorial's launch files and clients, and once more in lockstep.

With ~pillars_off on a poorer map, by the nodes alone.
"""

import os
import sys
import unittest

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.srv import GetMap, SetMap
from std_msgs.msg import Float64
from std_srvs.srv import Empty

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from ros_testing import Listener  # noqa: E402
from running_stack import Witness, run_client, start_test_node  # noqa: E402

from mbf_relay.geometry import normalize_angles  # noqa: E402
from mbf_relay.lockstep import Episode, circle, config_folder, make_setup  # noqa: E402
from mbf_relay.lockstep.smoothness import path_length  # noqa: E402
from mbf_relay.ros.common.conversions import header, map_from_message, map_to_message, pose_to_message  # noqa: E402
from mbf_relay.ros.tools.clients import CIRCLE  # noqa: E402
from mbf_relay.simulation.arena import PILLAR_RADIUS  # noqa: E402

NEAR = 0.15
"""Metres: the goal tolerance of the parameter file, 0.05, and what localization may be off."""

PILLARS_OFF = ((-1.1, 1.1), (1.1, 0.0), (0.0, -1.1))
"""A third of the arena's pillars: x, y (m)."""
DRIVES_SLOWER = "the robot drives slower until that is less"
"""What the server says where the machine is too slow for its controller, in whose time a drive then takes longer."""
OFF_THE_MAP = 0.1
"""Metres from the truth that localization may be while they are not on its map."""


class TestCircle(unittest.TestCase):
    trajectories, kept_up = {}, {}
    """By client, of those that have driven, and whether the machine had kept up with all of them by then."""

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
        self.trajectories[client] = witness.trajectory
        self.kept_up[client] = not any(DRIVES_SLOWER in line for line in witness.complaints())


class TestCircleAndLockstep(TestCircle):
    """The same parts with the same files, on the same map, give two drives of one kind."""

    def test_the_nodes_and_lockstep_drive_alike(self):
        client = CLIENTS[0]
        if client not in self.trajectories:
            self.drive(client)
        by_nodes = self.trajectories[client]
        rospy.ServiceProxy("simulator/pause", Empty)()  # nobody looks at the nodes meanwhile, and they compute on
        try:
            result = Episode(circle(), make_setup(config_folder()), seed=1).run()
        finally:
            rospy.ServiceProxy("simulator/unpause", Empty)()
        self.assertTrue(result.success, result.message)
        self.assertEqual((result.goals_reached, result.contacts), (len(CIRCLE), 0))
        in_lockstep = np.array(result.trajectory)

        share = time_on_the_way(by_nodes) / time_on_the_way(in_lockstep)
        self.assertGreater(share, 0.9)
        if self.kept_up[client]:
            self.assertLess(share, 1.1)
        self.assertLess(abs(path_length(by_nodes[:, 1:3]) / result.path_length - 1.0), 0.05)
        self.assertLess(np.median(distances(by_nodes[:, 1:3], in_lockstep[:, 1:3])), 0.1)


def time_on_the_way(rows):
    """Return the seconds from the first motion to the last; rows are time, x, y, heading."""
    moved = np.hypot(*np.diff(rows[:, 1:3], axis=0).T) + np.abs(normalize_angles(np.diff(rows[:, 3])))
    moving = np.flatnonzero(moved > 1e-3)
    return rows[moving[-1] + 1, 0] - rows[moving[0], 0]


def distances(points, others):
    """Return how far (m) each point is from the nearest of the others."""
    return np.hypot(*(points[:, None] - others[None]).T).min(axis=0)


def _test_of(client):
    def test(self):
        self.drive(client)

    return test


if __name__ == "__main__":
    start_test_node("circle_test")
    CLIENTS = rospy.get_param("~clients", ["mb_relay_client.py"])
    for _client in CLIENTS:  # each leaves the robot where it found it
        setattr(TestCircle, f"test_{os.path.splitext(_client)[0]}_drives_the_circle", _test_of(_client))
    _case = TestCircle if rospy.get_param("~pillars_off", False) else TestCircleAndLockstep
    rostest.rosrun("mbf_relay", "circle", _case)
