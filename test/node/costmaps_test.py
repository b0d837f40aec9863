#!/usr/bin/env python3
"""Two costmaps of both forms on topics: what feeds them, what they publish, and what they say of missing input."""

import os
import subprocess
import sys
import unittest

import numpy as np
import rospy
import rostest
from dynamic_reconfigure.client import Client
from geometry_msgs.msg import Point32, Polygon, PolygonStamped, TransformStamped
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import PointCloud2, PointField, Range

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from ros_testing import Listener, wait_until  # noqa: E402
from synthetic_room import RoomRobot, mounting, synthetic_room  # noqa: E402

from mbf_relay.costmap.cost_grid import LETHAL  # noqa: E402
from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.ros.common.conversions import header, map_to_message, transform_to_message  # noqa: E402
from mbf_relay.ros.common.parameters import read_namespace  # noqa: E402
from mbf_relay.ros.common.transforms import Transforms  # noqa: E402
from mbf_relay.ros.costmap.node import make_costmap_nodes  # noqa: E402
from mbf_relay.ros.costmap.publisher import OCCUPANCY  # noqa: E402

START = Pose2D(0.0, 1.0, 0.4)

LATE = """
import sys
import rospy
from nav_msgs.msg import OccupancyGrid
rospy.init_node("late", anonymous=True)
info = rospy.wait_for_message(sys.argv[1], OccupancyGrid, 30.0).info
print(info.width, info.height)
"""


def assembled(grids, updates):
    """Return the costmap a listener puts together from the last whole grid and the updates after it."""
    last = grids.messages[-1]
    data = np.array(last.data, dtype=np.int8).reshape(last.info.height, last.info.width)
    for update in updates.messages:
        if update.header.stamp > last.header.stamp:
            part = np.array(update.data, dtype=np.int8).reshape(update.height, update.width)
            data[update.y:update.y + update.height, update.x:update.x + update.width] = part
    return data


class TestCostmaps(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.room = synthetic_room()
        cls.map_publisher = rospy.Publisher("map", OccupancyGrid, queue_size=1, latch=True)
        cls.map_publisher.publish(map_to_message(cls.room, "map", rospy.get_rostime()))
        cls.map_updates = rospy.Publisher("map_updates", OccupancyGridUpdate, queue_size=1)
        cls.clouds = rospy.Publisher("cloud", PointCloud2, queue_size=1)
        cls.sonar = rospy.Publisher("sonar", Range, queue_size=1)
        cls.outlines = rospy.Publisher("~local_costmap/outline", Polygon, queue_size=1)
        cls.robot = RoomRobot(cls.room, START)
        now = rospy.get_rostime()
        mounts = [mounting(frame, mount, down, "base_footprint", now) for frame, _, mount, down in cls.robot.lidars]
        placed = TransformStamped(header("map", now), "odom", transform_to_message(cls.robot.odom_in_map))
        cls.robot._static.sendTransform(mounts + [placed])
        config = read_namespace("~")
        cls.transforms = Transforms()
        cls.nodes = make_costmap_nodes(config, cls.transforms)
        cls.grids, cls.updates = {}, {}
        for side, node in cls.nodes.items():
            node.start()
            cls.grids[side] = Listener(f"~{side}_costmap/costmap", OccupancyGrid)
            cls.updates[side] = Listener(f"~{side}_costmap/costmap_updates", OccupancyGridUpdate)

    @classmethod
    def tearDownClass(cls):
        cls.robot.stop()
        for node in cls.nodes.values():
            node.close()

    def setUp(self):
        self.robot.velocity = (0.0, 0.0)
        self.robot.scanning = True
        for side, node in self.nodes.items():
            wait_until(
                lambda: node.costmap.stale_reason(rospy.get_time()) is None, f"the {side} costmap to be up to date"
            )

    def picture(self, side):
        return self.nodes[side].costmap.snapshot()

    def test_what_a_sonar_sees_stands_in_the_way_and_is_gone_when_it_sees_farther(self):
        wait_until(lambda: self.sonar.get_num_connections() > 0, "the costmap to listen to the sonar")

        def cost_ahead(reading, distance):
            now = rospy.get_rostime()
            self.sonar.publish(Range(header("base_footprint", now), Range.ULTRASOUND, 0.3, 0.1, 3.0, reading))
            robot = self.transforms.lookup("map", "base_footprint")
            seen, (x, y) = self.picture("global"), robot.transform_points(np.array([[distance, 0.0]]))[0]
            column, row = seen.grid.cell_at(x, y)
            return seen.costs[row, column]

        wait_until(lambda: cost_ahead(0.8, 0.8) == LETHAL, "an obstacle where the sonar says")
        wait_until(lambda: cost_ahead(1.2, 0.8) < LETHAL, "a free place where the sonar sees through")

    def test_the_map_is_published_once_and_then_what_changed(self):
        grid = self.grids["global"].wait_for(lambda message: 100 in message.data, "a costmap with obstacles")
        self.assertEqual((grid.info.width, grid.info.height), (200, 120))
        self.assertEqual(grid.header.frame_id, "map")
        self.assertAlmostEqual(grid.info.origin.position.x, -2.0)
        whole = len(self.grids["global"].messages)
        update = OccupancyGridUpdate(header("map", rospy.get_rostime()), 100, 50, 2, 3, [100] * 6)
        wait_until(lambda: self.map_updates.get_num_connections() > 0, "the costmap to subscribe to map updates")
        since = len(self.updates["global"].messages)
        self.map_updates.publish(update)
        sent = self.updates["global"].wait_for(lambda message: 100 in message.data, "the changed window", since=since)
        self.assertTrue(sent.x <= 100 and sent.y <= 50 and sent.width < 60 and sent.height < 60)
        self.assertEqual(len(self.grids["global"].messages), whole)
        wait_until(
            lambda: (
                assembled(self.grids["global"], self.updates["global"]) == OCCUPANCY[self.picture("global").costs]
            ).all(),
            "the grid put together from updates to equal the costmap",
        )

    def test_whoever_comes_late_gets_the_whole_costmap(self):
        wait_until(lambda: self.grids["global"].messages, "the first costmap")
        # another process: here a second listener would share the first one's connection
        told = subprocess.run(
            [sys.executable, "-c", LATE, rospy.resolve_name("~global_costmap/costmap")], stdout=subprocess.PIPE,
            text=True, timeout=60.0)
        self.assertEqual(told.stdout.split(), ["200", "120"])

    def test_the_local_costmap_shows_what_the_lidar_sees_and_follows_the_robot(self):
        wait_until(lambda: self.grids["local"].messages, "the first costmap")
        # as it is now: the first with an obstacle may be of another test's size
        wait_until(lambda: 100 in assembled(self.grids["local"], self.updates["local"]), "a costmap with obstacles")
        grid = self.grids["local"].last
        self.assertEqual((grid.info.width, grid.info.height, grid.header.frame_id), (60, 60, "odom"))
        before = self.picture("local").grid.origin_x, self.picture("local").grid.origin_y
        self.robot.velocity = (0.3, 0.0)
        wait_until(
            lambda: (self.picture("local").grid.origin_x, self.picture("local").grid.origin_y) != before,
            "the window to move")

    def test_points_of_a_cloud_within_its_heights_become_obstacles(self):
        wait_until(lambda: self.clouds.get_num_connections() > 0, "the costmap to subscribe to the cloud")
        ahead = np.array([[0.5, 0.0, 0.2], [0.0, 0.5, 0.9], [np.nan, 0.0, 0.0]], dtype=np.float32)
        fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate("xyz")]

        def cost_at(x, y):
            picture = self.picture("local")
            point = self.robot.odom_pose.transform_points(np.array([[x, y]]))[0]
            column, row = picture.grid.cell_at(*point)
            return picture.costs[row, column]

        def marked():
            stamp = rospy.get_rostime()
            self.clouds.publish(PointCloud2(
                header("base_footprint", stamp), 1, 3, fields, False, 12, 36, ahead.tobytes(), False))
            return cost_at(0.5, 0.0) == 254

        wait_until(marked, "the low point to be marked", period=0.1)
        self.assertNotEqual(cost_at(0.0, 0.5), 254)

    def test_the_footprint_is_published_and_can_be_changed(self):
        outlines = Listener("~local_costmap/footprint", PolygonStamped)
        first = outlines.wait_for(lambda message: len(message.polygon.points) == 16, "the round footprint")
        self.assertEqual(first.header.frame_id, "odom")
        wait_until(lambda: self.outlines.get_num_connections() > 0, "the costmap to subscribe to outlines")
        self.outlines.publish(Polygon([Point32(-0.1, -0.1, 0.0), Point32(-0.1, 0.1, 0.0), Point32(0.2, 0.0, 0.0)]))
        outlines.wait_for(lambda message: len(message.polygon.points) == 3, "the new footprint")
        self.outlines.publish(Polygon([Point32(0.0, 0.0, 0.0)]))  # refused; the last one stays
        outlines.wait_for(
            lambda message: len(message.polygon.points) == 3, "the footprint to stay", since=len(outlines.messages)
        )
        outlines.close()

    def test_a_silent_source_is_named_until_it_speaks_again(self):
        self.robot.scanning = False

        def is_missed():
            level, text, _ = self.nodes["local"].report()
            reason = self.nodes["local"].costmap.stale_reason(rospy.get_time()) or ""
            return "source 'scan'" in reason and level == 2 and "scan" in text

        wait_until(is_missed, "the costmap to be stale, and to tell that the scan is missing")
        wait_until(
            lambda: self.nodes["global"].costmap.stale_reason(rospy.get_time()) is None,
            "the global costmap to be up to date without it",
        )
        self.robot.scanning = True
        wait_until(
            lambda: self.nodes["local"].costmap.stale_reason(rospy.get_time()) is None, "the costmap to be fresh"
        )

    def test_a_source_without_a_transform_is_named(self):
        real = self.robot.change_message

        def renamed(message):
            message.header.frame_id = "nowhere"
            return message

        said = []

        def names_the_frame():
            said.append(self.nodes["local"].report()[1])
            return "nowhere" in said[-1]

        self.robot.change_message = renamed
        try:
            wait_until(names_the_frame, lambda: f"a report that names the frame; the last one is '{said[-1]}'")
            self.assertIn("'scan'", said[-1])
        finally:
            self.robot.change_message = real

    def test_a_raised_inflation_radius_shows_in_the_published_costmap(self):
        client = Client("~global_costmap/inflation", timeout=30.0)
        self.assertEqual(client.get_configuration()["inflation_radius"], 0.5)

        def inflated():
            return (assembled(self.grids["global"], self.updates["global"]) > 0).sum()

        wait_until(lambda: self.grids["global"].messages, "the first costmap")
        before = wait_until(inflated, "inflated cells")
        self.assertEqual(client.update_configuration({"inflation_radius": 0.8})["inflation_radius"], 0.8)
        wait_until(lambda: inflated() > 1.3 * before, "costs farther from the walls")
        client.update_configuration({"inflation_radius": 0.5})
        wait_until(lambda: inflated() == before, "the costs of before")
        client.update_configuration({"enabled": False})
        wait_until(lambda: inflated() == (OCCUPANCY[self.picture("global").costs] == 100).sum(), "lethal cells alone")
        client.update_configuration({"enabled": True})
        wait_until(lambda: inflated() == before, "the costs to come back")
        client.close()

    def test_a_window_takes_another_size_and_refuses_what_cannot_be(self):
        client = Client("~local_costmap", timeout=30.0)
        self.assertEqual(client.get_configuration()["footprint"], "[]")
        client.update_configuration({"width": 4.0, "robot_radius": 0.2})
        self.grids["local"].wait_for(lambda message: message.info.width == 80, "a window of 4 m")
        self.assertAlmostEqual(self.picture("local").circumscribed_radius, 0.2, delta=0.02)
        for wrong in ({"width": 0.01}, {"footprint": "[[0.1, 0.1]]"}, {"resolution": 0.0}):
            answer = client.update_configuration(wrong)
            self.assertEqual((answer["width"], answer["footprint"], answer["resolution"]), (4.0, "[]", 0.05))
        since = len(self.grids["local"].messages)
        client.update_configuration({"width": 3.0, "robot_radius": 0.1})
        self.grids["local"].wait_for(lambda message: message.info.width == 60, "a window of 3 m", since=since)
        client.close()

    def test_a_costmap_keeps_the_size_of_its_map(self):
        client = Client("~global_costmap", timeout=30.0)
        before = client.get_configuration()
        self.assertEqual(client.update_configuration({"width": before["width"] + 1.0})["width"], before["width"])
        self.assertEqual(self.picture("global").grid.shape, (120, 200))
        client.close()

    def test_resting_costmaps_stand_still(self):
        node = self.nodes["global"]
        node.rest()
        wait_until(lambda: node.costmap.stale_reason(rospy.get_time()), "a resting costmap to be stale", timeout=10.0)
        node.resume()
        wait_until(lambda: node.costmap.stale_reason(rospy.get_time()) is None, "it to be up to date again")


if __name__ == "__main__":
    rospy.init_node("costmaps")
    rostest.rosrun("mbf_relay", "costmaps", TestCostmaps)
