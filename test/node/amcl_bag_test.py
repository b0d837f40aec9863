#!/usr/bin/env python3
"""amcl from a bag, and a bag as a log: a recorded drive with two lidars, one of them upside down."""

import os
import re
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import rosbag
import rospy
import rostest
from geometry_msgs.msg import TransformStamped
from nav_msgs.srv import GetMap, GetMapResponse
from tf2_msgs.msg import TFMessage

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from programs import program  # noqa: E402
from synthetic_room import lidar_message, mounting, synthetic_room  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.localization.distance_field import DistanceField  # noqa: E402
from mbf_relay.localization.logs import load_log  # noqa: E402
from mbf_relay.localization.parameters import LocalizerParameters  # noqa: E402
from mbf_relay.localization.replay import errors, replay  # noqa: E402
from mbf_relay.ros.common.conversions import header, map_to_message, transform_to_message  # noqa: E402

START = Pose2D(0.0, 1.0, 0.4)
FRONT = ("front", Pose2D(0.1, 0.0, 0.0), False)
REAR = ("/rear", Pose2D(-0.1, 0.0, 3.0), True)


def record(path, lidars):
    """Write a bag of a drive through the room; return its true poses."""
    room, rng = DistanceField(synthetic_room(), 2.0), np.random.default_rng(1)
    odom_in_map, truth, way = START.compose(Pose2D(0.3, -0.2, 0.5)), START, []
    with rosbag.Bag(path, "w") as bag:
        for index in range(60):
            stamp = rospy.Time.from_sec(100.0 + 0.2 * index)
            truth = truth.compose(Pose2D(0.05, 0.0, 0.12))
            way.append(truth)
            odom = TransformStamped(
                header("odom", stamp), "base_link", transform_to_message(truth.relative_to(odom_in_map))
            )
            bag.write("/tf", TFMessage([odom] + [mounting(f, p, d, "base_link", stamp) for f, p, d in lidars]), stamp)
            for frame, pose, upside_down in lidars:
                bag.write("scan", lidar_message(room, truth, frame, pose, upside_down, stamp, rng), stamp)
    return np.array(way)


def run(*command):
    """Run one of the package's commands, which is to leave nothing behind where temporary files go."""
    with tempfile.TemporaryDirectory() as folder:
        done = subprocess.run(
            [program(command[0]), *command[1:]], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            timeout=60, env=dict(os.environ, TMPDIR=folder),
        )
        assert os.listdir(folder) == [], f"{command[0]} has left {os.listdir(folder)} in {folder}"
        return done


class TestBags(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = folder.name
        self.bag = os.path.join(self.folder, "drive.bag")

    def test_run_from_bag_ends_where_the_robot_did(self):
        way = record(self.bag, (FRONT, REAR))
        service = rospy.Service(
            "static_map", GetMap, lambda _: GetMapResponse(map_to_message(synthetic_room(), "map", rospy.get_rostime()))
        )
        done = run(
            "amcl", "--run-from-bag", self.bag, f"_initial_pose_x:={START.x}", f"_initial_pose_y:={START.y}",
            f"_initial_pose_a:={START.theta}", "_resample_interval:=1", "_seed:=1",
        )
        service.shutdown()
        found = re.search(r"final location (\S+), (\S+), (\S+)", done.stdout)
        self.assertTrue(found, done.stdout)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertLess(Pose2D(*map(float, found.groups())).distance_to(Pose2D(*way[-1])), 0.1)

    def test_a_bag_becomes_a_log(self):
        for lidar in (FRONT, REAR):
            way = record(self.bag, (lidar,))
            path = os.path.join(self.folder, "drive.npz")
            done = run("bag_to_log.py", self.bag, path)
            self.assertEqual(done.returncode, 0, done.stdout)
            self.assertNotIn("Warning", done.stdout)
            log = load_log(path)
            self.assertEqual(len(log), 60)
            result = replay(
                log, synthetic_room(), LocalizerParameters(), np.random.default_rng(1), START,
                np.diag([0.02, 0.02, 0.01]),
            )
            self.assertLess(np.median(errors(result.poses, way)["translation"]), 0.05)

    def test_what_is_no_bag_is_named(self):
        with open(self.bag, "w") as file:
            file.write("no bag")
        for command in (
            ("amcl", "--run-from-bag", self.bag),
            ("bag_to_log.py", self.bag, "out.npz"),
            ("bag_to_log.py", "none.bag", "out.npz"),
        ):
            done = run(*command)
            self.assertEqual(done.returncode, 1, done.stdout)
            self.assertIn(".bag", done.stdout)
            self.assertNotIn("Traceback", done.stdout)


if __name__ == "__main__":
    rospy.init_node("amcl_bag_test")
    rostest.rosrun("mbf_relay", "amcl_bag", TestBags)
