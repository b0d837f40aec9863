#!/usr/bin/env python3
"""Keepout and speed zones of masks that a map_server node serves and changes while the costmap runs."""

import os
import sys
import tempfile
import unittest

import numpy as np
import rospy
import rostest
from geometry_msgs.msg import TransformStamped
from nav_msgs.srv import LoadMap, LoadMapResponse

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from ros_testing import wait_until  # noqa: E402
from synthetic_room import RoomRobot, synthetic_room  # noqa: E402

from mbf_relay.costmap.cost_grid import LETHAL  # noqa: E402
from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.maps import FREE, OCCUPIED, OccupancyMap, save_map  # noqa: E402
from mbf_relay.ros.common.conversions import header, transform_to_message  # noqa: E402
from mbf_relay.ros.common.transforms import Transforms  # noqa: E402
from mbf_relay.ros.costmap.node import CostmapNode  # noqa: E402

ROBOT = Pose2D(-1.990, -0.508, 0.0)
BESIDE = (-0.6, 0.4)
"""A place on the arena's floor."""


class TestMapZones(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.robot = RoomRobot(synthetic_room(), ROBOT)
        cls.robot.scanning = False
        odom = transform_to_message(cls.robot.odom_in_map)
        placed = TransformStamped(header("map", rospy.get_rostime()), "odom", odom)
        cls.robot._static.sendTransform([placed])
        rospy.wait_for_service("change_map", 60.0)
        cls.change = rospy.ServiceProxy("change_map", LoadMap)
        cls.change(cls.mask())
        zones = [("static", "costmap_2d::StaticLayer"), ("keepout", "nav2_costmap_2d::KeepoutFilter"),
                 ("slow", "nav2_costmap_2d::SpeedFilter")]
        cls.node = CostmapNode("global_costmap", {"global_costmap": {
            "global_frame": "map", "robot_base_frame": "base_footprint", "robot_radius": 0.1, "update_frequency": 10.0,
            "plugins": [{"name": name, "type": kind} for name, kind in zones], "static": {"map_topic": "/map"},
            "keepout": {"filter_mask_topic": "map"}, "slow": {"filter_mask_topic": "map", "multiplier": -0.6}}},
            Transforms())
        cls.node.start()
        wait_until(lambda: cls.node.costmap.stale_reason(rospy.get_time()) is None, "a costmap with its masks")

    @classmethod
    def tearDownClass(cls):
        cls.node.close()
        cls.robot.stop()
        cls.folder.cleanup()

    @classmethod
    def mask(cls, *places):
        """Return the file of a mask with a zone of 0.4 m around each of some places."""
        data = np.full((60, 60), FREE, np.int8)
        for x, y in places:
            column, row = int((x + 3.0) / 0.1), int((y + 3.0) / 0.1)
            data[row - 2:row + 3, column - 2:column + 3] = OCCUPIED
        occupancy = OccupancyMap(data, 0.1, Pose2D(-3.0, -3.0, 0.0))
        return save_map(os.path.join(cls.folder.name, f"mask_{len(places)}"), occupancy)[0]

    def cost(self, x, y):
        picture = self.node.costmap.snapshot()
        column, row = picture.grid.cell_at(x, y)
        return picture.costs[row, column]

    def test_a_mask_served_anew_closes_a_place_and_slows_the_robot_and_opens_it_again(self):
        self.assertLess(self.cost(*BESIDE), LETHAL)
        self.assertEqual(self.node.costmap.zone_limit.share, 1.0)
        self.assertEqual(self.change(self.mask((ROBOT.x, ROBOT.y), BESIDE)).result, LoadMapResponse.RESULT_SUCCESS)
        wait_until(lambda: self.cost(*BESIDE) == LETHAL, "the place to be closed")
        wait_until(lambda: abs(self.node.costmap.zone_limit.share - 0.4) < 1e-6, "the robot's zone to be slow")
        self.change(self.mask())
        wait_until(lambda: self.cost(*BESIDE) < LETHAL, "the place to be open again")
        wait_until(lambda: self.node.costmap.zone_limit.share == 1.0, "the robot to be free to drive on")


if __name__ == "__main__":
    rospy.init_node("map_zones_test")
    rostest.rosrun("mbf_relay", "map_zones", TestMapZones)
