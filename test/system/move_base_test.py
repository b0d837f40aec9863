#!/usr/bin/env python3
"""move_base by itself, under a launch file that was written for C++'s."""

import math
import os
import sys
import unittest

import actionlib
import dynamic_reconfigure.client
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
from upstream_graph import README, UPSTREAM, differences, graph_of, unexplained, upstream_graph  # noqa: E402

from mbf_relay.ros.relay import answers  # noqa: E402

START = (-1.990, -0.508)
NODE = "/move_base"
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

    def test_2_whatever_a_client_finds_in_the_graph_is_move_base_s_or_explained(self):
        upstream = upstream_graph(NODE)
        ours = graph_of(NODE)
        texts = {text for text in vars(answers).values() if isinstance(text, str)}
        unsaid = {("says", text, "not here") for text in UPSTREAM["says"] if text not in texts}
        self.assertEqual(unexplained(differences(ours, upstream) | unsaid, NODE), [])
        counts = [f"{len(names)} {words}" for names, words in zip(
            (*upstream.values(), UPSTREAM["says"]),
            ("topics published", "subscribed", "services", "reconfigure servers", "status texts"),
        )]
        self.assertIn(", ".join(counts), README.read_text(encoding="utf-8").replace("\n", " "))
        rospy.ServiceProxy("/move_base/clear_costmaps", Empty)()

    def test_3_parameters_are_readable_and_changed_as_upstream(self):
        self.assertEqual(rospy.get_param("/move_base/base_local_planner"), "base_local_planner/TrajectoryPlannerROS")
        self.assertEqual(rospy.get_param("/move_base/TrajectoryPlannerROS/max_vel_x"), 0.2)
        self.assertEqual(rospy.get_param("/move_base/planner_frequency"), 1.0)
        self.assertEqual(rospy.get_param("/move_base/controller_patience"), 15.0, "as where no file gives it")
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
        client.update_configuration({"base_global_planner": "global_planner/GlobalPlanner"})
        self.assertEqual(self.go(pose(*START))[0], GoalStatus.SUCCEEDED)
        chosen = differences(graph_of(NODE), {"subscribes": {}, **upstream_graph(NODE, "chosen_later")})
        self.assertEqual([missing for missing in chosen if missing[2] != "only here"], [])
        refused = client.update_configuration({"base_local_planner": "our_planner/OurPlanner"})
        self.assertEqual(refused["base_local_planner"], "dwa_local_planner/DWAPlannerROS")

    def test_7_nothing_was_touched(self):
        self.assertEqual(self.witness.touched(), [])


if __name__ == "__main__":
    start_test_node("one_process_test")
    rostest.rosrun("mbf_relay", "one_process", TestMoveBase)
