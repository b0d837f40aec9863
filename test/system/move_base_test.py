#!/usr/bin/env python3
"""move_base by itself, under a launch file that was written for C++'s."""

import math
import os
import sys
import unittest

import actionlib
import dynamic_reconfigure.client
import rosgraph
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import OccupancyGrid, Path
from nav_msgs.srv import GetPlan, GetPlanRequest
from std_srvs.srv import Empty

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from running_stack import Witness, start_test_node  # noqa: E402

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

from ros_testing import Listener, wait_until  # noqa: E402

START = (-1.990, -0.508)
BLOCKED = (0.0, 0.0)
"""The middle pillar of the world."""


def pose(x, y, heading=0.0, frame="map"):
    result = PoseStamped()
    result.header.frame_id = frame
    result.pose.position.x, result.pose.position.y = x, y
    result.pose.orientation.z, result.pose.orientation.w = math.sin(heading / 2.0), math.cos(heading / 2.0)
    return result


class TestMoveBase(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.witness = Witness()
        cls.client = actionlib.SimpleActionClient("move_base", MoveBaseAction)
        wait_until(lambda: cls.client.wait_for_server(rospy.Duration(0.1)), "the action move_base", 120.0)

    def go(self, target):
        self.client.send_goal(MoveBaseGoal(target))
        wait_until(
            lambda: self.client.get_state() not in (GoalStatus.PENDING, GoalStatus.ACTIVE), "the goal's end", 120.0
        )
        return self.client.get_state(), self.client.get_goal_status_text()

    def test_1_a_goal_is_taken_as_soon_as_there_is_an_action_and_reached(self):
        self.assertEqual(self.go(pose(START[0] + 0.6, START[1] + 0.1, 1.0)), (GoalStatus.SUCCEEDED, "Goal reached."))
        self.assertLess(self.witness.way_to(START[0] + 0.6, START[1] + 0.1), 0.2)
        self.assertEqual(self.go(pose(*START)), (GoalStatus.SUCCEEDED, "Goal reached."))
        self.assertEqual(self.witness.touched(), [])

    def test_2_topics_and_services_have_move_base_s_names(self):
        master = rosgraph.Master(rospy.get_name())
        published = {name for name, nodes in master.getSystemState()[0] if "/move_base" in nodes}
        for name in (
            "/cmd_vel",
            "/move_base/status",
            "/move_base/result",
            "/move_base/feedback",
            "/move_base/current_goal",
            "/move_base/recovery_status",
            "/move_base/global_costmap/costmap",
            "/move_base/local_costmap/costmap",
            "/move_base/local_costmap/footprint",
            "/move_base/NavfnROS/plan",
            "/move_base/NavfnROS/potential",
            "/move_base/TrajectoryPlannerROS/global_plan",
            "/move_base/TrajectoryPlannerROS/local_plan",
            "/move_base/TrajectoryPlannerROS/cost_cloud",
            "/move_base/parameter_updates",
            "/move_base/TrajectoryPlannerROS/parameter_updates",
            "/move_base/global_costmap/parameter_updates",
            "/move_base/local_costmap/inflation_layer/parameter_updates",
        ):
            self.assertIn(name, published)
        served = {name for name, _nodes in master.getSystemState()[2]}
        for name in (
            "/move_base/make_plan",
            "/move_base/clear_costmaps",
            "/move_base/pause",
            "/move_base/resume",
            "/move_base/NavfnROS/make_plan",
            "/move_base/set_parameters",
        ):
            self.assertIn(name, served)
        rospy.ServiceProxy("/move_base/clear_costmaps", Empty)()

    def test_3_parameters_are_readable_and_changed_as_upstream(self):
        self.assertEqual(rospy.get_param("/move_base/base_local_planner"), "base_local_planner/TrajectoryPlannerROS")
        self.assertEqual(rospy.get_param("/move_base/TrajectoryPlannerROS/max_vel_x"), 0.2)
        self.assertEqual(rospy.get_param("/move_base/planner_frequency"), 1.0)
        changed = dynamic_reconfigure.client.Client("/move_base/TrajectoryPlannerROS").update_configuration(
            {"max_vel_x": 0.15}
        )
        self.assertEqual(changed["max_vel_x"], 0.15)
        self.assertEqual(rospy.get_param("/move_base/TrajectoryPlannerROS/max_vel_x"), 0.15)

    def test_4_plans_are_answered_at_once_whether_there_is_one_or_not(self):
        plan = rospy.ServiceProxy("/move_base/make_plan", GetPlan)
        by_navfn = rospy.ServiceProxy("/move_base/NavfnROS/make_plan", GetPlan)
        start = pose(*START)
        for service in (plan, by_navfn):
            self.assertGreater(len(service(start, pose(0.5, 1.8), 0.0).plan.poses), 20)
            self.assertEqual(service(start, pose(*BLOCKED), 0.0).plan.poses, [])
            self.assertEqual(service(start, pose(0.0, 0.0, frame="nowhere"), 0.0).plan.poses, [])
        before = rospy.get_time()
        for _ in range(50):
            plan(GetPlanRequest(start=start, goal=pose(*BLOCKED)))
        self.assertLess(rospy.get_time() - before, 50 * 4.0, "each used to wait for the planner's patience, 5 s")

    def test_5_the_map_and_the_plan_are_shown_where_rviz_looks(self):
        costmap = Listener("/move_base/global_costmap/costmap", OccupancyGrid)
        plan = Listener("/move_base/NavfnROS/plan", Path, connected=True)
        self.assertEqual(self.go(pose(START[0] + 0.4, START[1]))[0], GoalStatus.SUCCEEDED)
        plan.wait_for(lambda message: len(message.poses) > 5, "a plan")
        costmap.wait_for(lambda message: message.info.width > 100, "the costmap")
        self.assertEqual(self.go(pose(*START))[0], GoalStatus.SUCCEEDED)

    def test_6_another_planner_is_loaded_at_run_time_and_an_unknown_one_refused(self):
        client = dynamic_reconfigure.client.Client("/move_base")
        changed = client.update_configuration({"base_local_planner": "dwa_local_planner/DWAPlannerROS"})
        self.assertEqual(changed["base_local_planner"], "dwa_local_planner/DWAPlannerROS")
        self.assertEqual(self.go(pose(START[0] + 0.4, START[1]))[0], GoalStatus.SUCCEEDED)
        self.assertIn("/move_base/GlobalPlanner/potential", self.published_with_planner(client))
        refused = client.update_configuration({"base_local_planner": "our_planner/OurPlanner"})
        self.assertEqual(refused["base_local_planner"], "dwa_local_planner/DWAPlannerROS")

    def published_with_planner(self, client):
        """Return the topics move_base publishes once it has global_planner's planner as well."""
        client.update_configuration({"base_global_planner": "global_planner/GlobalPlanner"})
        self.assertEqual(self.go(pose(*START))[0], GoalStatus.SUCCEEDED)
        state = rosgraph.Master(rospy.get_name()).getSystemState()
        return {name for name, nodes in state[0] if "/move_base" in nodes}

    def test_7_nothing_was_touched(self):
        self.assertEqual(self.witness.touched(), [])


if __name__ == "__main__":
    start_test_node("one_process_test")
    rostest.rosrun("mbf_relay", "one_process", TestMoveBase)
