#!/usr/bin/env python3
"""The controller's topics and its dynamic reconfigure, as RViz and rqt use them."""

import os
import sys
import unittest

import rospy
import rostest
from dynamic_reconfigure.client import Client
from nav_msgs.msg import Path
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from ros_testing import Listener, wait_until  # noqa: E402

from mbf_relay.ros.common.conversions import pose_from_message  # noqa: E402

NAME = "/move_base_flex/DWAPlannerROS"


class ControllerTopics(unittest.TestCase):
    """Against paper_controller.py."""

    def setUp(self):
        self.client = Client(NAME, timeout=30.0)
        self.addCleanup(self.client.close)

    def listen(self, topic, kind):
        listener = Listener(f"{NAME}/{topic}", kind)
        self.addCleanup(listener.close)
        return listener

    def test_plans_are_in_the_costmaps_frame_and_lead_on(self):
        def leads_on(message):
            poses = [pose_from_message(pose.pose) for pose in message.poses]
            steps = [there.relative_to(here).x for here, there in zip(poses, poses[1:])]
            return len(steps) > 2 and min(steps) > -1e-6 and sum(steps) > 0.05

        for topic in ("global_plan", "local_plan"):  # on the spot, where it turns, it leads nowhere
            plan = self.listen(topic, Path).wait_for(leads_on, "a plan of several poses, each ahead of the last")
            self.assertEqual(plan.header.frame_id, "odom")
            self.assertEqual({pose.header.frame_id for pose in plan.poses}, {"odom"})

    def test_the_clouds_come_when_asked_for_with_upstreams_fields(self):
        costs, trajectories = self.listen("cost_cloud", PointCloud2), self.listen("trajectory_cloud", PointCloud2)
        self.client.update_configuration({"publish_traj_pc": True, "publish_cost_grid_pc": True})
        cloud = costs.wait_for(lambda message: message.width > 0, "a cost cloud")
        self.assertEqual(
            [f.name for f in cloud.fields], ["x", "y", "z", "path_cost", "goal_cost", "occ_cost", "total_cost"]
        )
        self.assertEqual(len(cloud.data), cloud.width * cloud.point_step)
        cloud = trajectories.wait_for(lambda message: message.width > 100, "a trajectory cloud")
        self.assertEqual([f.name for f in cloud.fields], ["x", "y", "z", "theta", "cost"])
        self.client.update_configuration({"publish_traj_pc": False, "publish_cost_grid_pc": False})

    def test_it_explains_itself(self):
        text = self.listen("explanation", String).wait_for(lambda message: "chosen" in message.data, "an explanation")
        self.assertIn("trajectories", text.data)

    def test_parameters_start_as_given_change_and_are_checked(self):
        before = wait_until(lambda: self.client.get_configuration(timeout=5.0), "the configuration")
        self.assertAlmostEqual(before["max_vel_trans"], 0.22, msg="read by its older name max_trans_vel")
        self.assertEqual(before["vx_samples"], 20)
        self.assertAlmostEqual(self.client.update_configuration({"xy_goal_tolerance": 0.08})["xy_goal_tolerance"], 0.08)
        refused = self.client.update_configuration({"min_vel_trans": 0.5})
        self.assertAlmostEqual(refused["min_vel_trans"], 0.11, msg="above max_vel_trans")
        restored = self.client.update_configuration({"restore_defaults": True})
        self.assertAlmostEqual(restored["xy_goal_tolerance"], 0.05)
        self.assertFalse(restored["restore_defaults"])

    def test_a_lower_speed_holds_at_once(self):
        plans = self.listen("local_plan", Path)

        def reach(message):
            start, end = message.poses[0].pose.position, message.poses[-1].pose.position
            return ((end.x - start.x) ** 2 + (end.y - start.y) ** 2) ** 0.5

        plans.wait_for(lambda message: len(message.poses) > 3 and reach(message) > 0.25, "a plan at full speed")
        self.client.update_configuration({"max_vel_trans": 0.12})
        since = len(plans.messages)
        plans.wait_for(lambda m: len(m.poses) > 2 and reach(m) < 0.2, "a plan at half speed", since=since)
        self.client.update_configuration({"restore_defaults": True})


if __name__ == "__main__":
    rospy.init_node("controller_topics_test")
    rostest.rosrun("mbf_relay", "controller_topics", ControllerTopics)
