#!/usr/bin/env python3
"""The map_server and map_saver nodes: what they serve, change and write, and what they refuse."""

import os
import subprocess
import sys
import tempfile
import unittest

import numpy as np
import rospkg
import rospy
import rostest
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap, LoadMap, LoadMapResponse

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from programs import program  # noqa: E402
from ros_testing import Listener  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.maps import OccupancyMap, load_map, save_map  # noqa: E402
from mbf_relay.ros.common.conversions import map_from_message  # noqa: E402

ARENA = os.path.join(rospkg.RosPack().get_path("mbf_relay"), "config", "maps", "turtlebot3_world.yaml")


class TestMapServer(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = folder.name
        cls.arena = load_map(ARENA)
        rospy.wait_for_service("change_map", 30.0)
        cls.change = rospy.ServiceProxy("change_map", LoadMap)

    def tearDown(self):
        self.change(ARENA)

    def assert_same(self, message, occupancy):
        received = map_from_message(message)
        self.assertTrue(np.array_equal(received.data, occupancy.data))
        self.assertAlmostEqual(received.resolution, occupancy.resolution, places=6)
        for got, expected in zip(received.origin, occupancy.origin):
            self.assertAlmostEqual(got, expected, places=6)

    def small_map(self):
        occupancy = OccupancyMap(np.array([[0, 100, -1], [100, 0, 0]], dtype=np.int8), 0.2, Pose2D(1.0, -2.0, 0.5))
        return save_map(os.path.join(self.folder, "small"), occupancy)[0], occupancy

    def test_topics_are_latched_and_the_service_gives_the_same(self):
        height, width = self.arena.data.shape  # a listener of another test's may hold that one's map a moment longer
        grid = Listener("map", OccupancyGrid).wait_for(lambda m: (m.info.height, m.info.width) == (height, width), "it")
        self.assert_same(grid, self.arena)
        self.assertEqual(grid.header.frame_id, "map")
        Listener("map_metadata", MapMetaData).wait_for(lambda m: (m.height, m.width) == (height, width), "its metadata")
        self.assert_same(rospy.ServiceProxy("static_map", GetMap)().map, self.arena)

    def test_another_map_is_published_and_a_wrong_one_changes_nothing(self):
        listener = Listener("map", OccupancyGrid, connected=True)
        path, small = self.small_map()
        self.assertEqual(self.change(path).result, LoadMapResponse.RESULT_SUCCESS)
        self.assert_same(listener.wait_for(lambda m: m.info.width == 3, "the small map"), small)
        broken = os.path.join(self.folder, "broken.yaml")
        with open(broken, "w") as file:
            file.write("image: small.pgm\n")
        no_image = os.path.join(self.folder, "no_image.yaml")
        with open(path) as source, open(no_image, "w") as file:
            file.write(source.read().replace("small.pgm", "broken.yaml"))
        for wrong, result in (
            (os.path.join(self.folder, "none.yaml"), LoadMapResponse.RESULT_MAP_DOES_NOT_EXIST),
            (broken, LoadMapResponse.RESULT_INVALID_MAP_METADATA), (no_image, LoadMapResponse.RESULT_INVALID_MAP_DATA),
        ):
            self.assertEqual(self.change(wrong).result, result)
        self.assert_same(rospy.ServiceProxy("static_map", GetMap)().map, small)

    def test_the_saver_writes_what_is_served(self):
        path, small = self.small_map()
        self.change(path)
        stem = os.path.join(self.folder, "saved")
        done = subprocess.run(
            [program("map_saver"), "-f", stem],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=30,
        )
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertTrue(np.array_equal(load_map(stem + ".yaml").data, small.data))

    def test_programs_end_with_one_line_that_says_what_is_wrong(self):
        for command, complaint in (
            (["map_server", "/none/such.yaml", "__name:=wrong_map_server"], b"/none/such.yaml"),
            (["map_saver", "--occ", "10", "--free", "20"], b"--occ is 10"),
        ):
            done = subprocess.run(
                [program(command[0]), *command[1:]], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, timeout=30
            )
            self.assertEqual(done.returncode, 1, done.stdout)
            self.assertIn(complaint, done.stdout)
            self.assertNotIn(b"Traceback", done.stdout)


if __name__ == "__main__":
    rospy.init_node("map_server_test")
    rostest.rosrun("mbf_relay", "map_server", TestMapServer)
