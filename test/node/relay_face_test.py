#!/usr/bin/env python3
"""What else a move_base has, at the relay: the goal topic, services, parameters, and topics for RViz."""

import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import rosgraph
import rospy
import rostest
import tf2_ros
from actionlib_msgs.msg import GoalID, GoalStatus
from dynamic_reconfigure.client import Client as ReconfigureClient
from geometry_msgs.msg import PoseStamped, TransformStamped
from move_base_msgs.msg import MoveBaseActionGoal, RecoveryStatus
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetPlan, GetPlanRequest
from node.relay_case import RelayCase
from node.scripted_server import SCRIPTS
from ros_testing import Listener, connected_publisher, wait_until
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Empty, Trigger


class RelayFaceTest(RelayCase):
    def test_a_simple_goal_is_an_action_goal_that_anyone_can_cancel(self):
        self.make_sure_of_server()
        seen = Listener("move_base/goal", MoveBaseActionGoal)
        simple = connected_publisher("move_base_simple/goal", PoseStamped)
        wait_until(lambda: "/move_base" in seen.publishers, "the relay's action goals")
        pose = PoseStamped()
        pose.header.frame_id, pose.pose.position.x, pose.pose.position.z = "map", 42.0, SCRIPTS["drive"]
        pose.pose.orientation.w = 1.0
        simple.publish(pose)
        seen.wait_for(lambda m: m.goal.target_pose.pose.position.x == 42.0, "the action goal")
        self.current_goal.wait_for(lambda m: m.pose.position.x == 42.0, "the goal")
        feedback = self.feedback.wait_for(lambda m: m.feedback.base_position.pose.position.x == 42.0, "feedback")
        self.cancels.publish(GoalID(id=feedback.status.goal_id.id))
        self.check_end(feedback.status.goal_id.id, GoalStatus.PREEMPTED, "")

    def test_a_plan_is_made_also_while_driving(self):
        self.make_sure_of_server()
        running = self.send("drive")
        self.wait_for_feedback(running)
        make_plan = rospy.ServiceProxy("move_base/make_plan", GetPlan)
        request = GetPlanRequest(tolerance=0.5)
        request.goal.header.frame_id, request.goal.pose.position.x = "map", 3.0
        self.assertEqual([p.pose.position.x for p in make_plan(request).plan.poses], [0.0, 3.0])
        request.goal.pose.position.z = SCRIPTS["no_plan"]
        self.assertEqual(make_plan(request).plan.poses, [])
        wait_until(lambda: self.reported("plan False 255 1.0"), "the request at the server")
        self.assertFalse(any(m.status.goal_id.id == running for m in self.results.messages))
        self.cancels.publish(GoalID(id=running))
        self.check_end(running, GoalStatus.PREEMPTED, "")

    def test_an_explorer_gets_plans_from_the_planners_own_services(self):
        self.make_sure_of_server()
        request = GetPlanRequest()
        request.goal.header.frame_id, request.goal.pose.position.x = "map", 4.0
        for planner, at_server in (("NavfnROS", "navfn"), ("GlobalPlanner", "GP")):
            make_plan = rospy.ServiceProxy(f"move_base/{planner}/make_plan", GetPlan)
            make_plan.wait_for_service(timeout=30.0)
            self.assertEqual([p.pose.position.x for p in make_plan(request).plan.poses], [0.0, 4.0])
            wait_until(lambda name=at_server: self.reported("plan", f" {name}"), "the request at the server")

    def test_costmaps_are_cleared_at_the_server(self):
        self.make_sure_of_server()
        rospy.ServiceProxy("move_base/clear_costmaps", Empty)()
        wait_until(lambda: self.reported("clear"), "the request at the server")

    def test_a_server_that_cannot_pause_is_told_of_in_words(self):
        self.make_sure_of_server()
        answer = rospy.ServiceProxy("move_base/pause", Trigger)()
        self.assertFalse(answer.success)
        self.assertIn("/move_base_flex/pause", answer.message)

    def test_changes_of_parameters_and_nothing_else_reach_the_server(self):
        self.make_sure_of_server()
        wait_until(lambda: self.reported("reconfigure", "planner_patience", "9.0"), "the patience set at start")
        client = ReconfigureClient("move_base", timeout=10)
        wait_until(lambda: client.get_configuration()["controller_frequency"] == 10.0, "the server's own frequency")
        client.update_configuration({"max_planning_retries": 4, "conservative_reset_dist": 1.0})
        wait_until(lambda: self.reported("reconfigure [('planner_max_retries', 4)]"), "the change")
        self.check_end(self.send("arrive", x=81.0), GoalStatus.SUCCEEDED, "Goal reached.")
        self.wait_for_report("goal arrive 81.0 GP")
        client.update_configuration({"base_global_planner": "navfn/NavfnROS"})
        self.check_end(self.send("arrive", x=82.0), GoalStatus.SUCCEEDED, "Goal reached.")
        self.wait_for_report("goal arrive 82.0 navfn")
        refused = client.update_configuration({"base_global_planner": "carrot_planner/CarrotPlanner"})
        self.assertEqual(refused["base_global_planner"], "navfn/NavfnROS")
        self.assertFalse(self.reported("controller_frequency"))
        client.update_configuration({"base_global_planner": "global_planner/GlobalPlanner"})
        client.close()

    def test_who_tries_another_controller_gets_the_one_of_before_back(self):
        """move_base's default stands for the server's first, and no server need have it: it was refused, by
        restore_defaults too, and all that was changed with it."""
        self.make_sure_of_server()
        client = ReconfigureClient("move_base", timeout=10)
        before = client.get_configuration()
        another = {"base_local_planner": "dwa_local_planner/DWAPlannerROS"}
        for number, back in enumerate((
                {"base_local_planner": before["base_local_planner"], "make_plan_add_unreachable_goal": True},
                {"restore_defaults": True})):
            client.update_configuration({**another, "make_plan_add_unreachable_goal": False})
            self.check_end(self.send("arrive", x=83.0 + number), GoalStatus.SUCCEEDED, "Goal reached.")
            self.wait_for_report(f"goal arrive {83.0 + number} GP DWA")
            after = client.update_configuration(back)
            self.assertEqual(after["base_local_planner"], before["base_local_planner"])
            self.assertTrue(after["make_plan_add_unreachable_goal"])
            self.check_end(self.send("arrive", x=93.0 + number), GoalStatus.SUCCEEDED, "Goal reached.")
            self.assertNotIn("DWA", self.wait_for_report(f"goal arrive {93.0 + number} GP"))
        client.close()

    def test_a_goal_in_another_frame_is_shown_in_the_map(self):
        self.make_sure_of_server()
        broadcaster = tf2_ros.StaticTransformBroadcaster()
        transform = TransformStamped()
        transform.header.frame_id, transform.child_frame_id = "map", "base_link"
        transform.transform.translation.x, transform.transform.rotation.w = 5.0, 1.0
        broadcaster.sendTransform(transform)
        self.check_end(self.send("arrive", x=2.0, frame="base_link"), GoalStatus.SUCCEEDED, "Goal reached.")
        self.current_goal.wait_for(
            lambda m: (m.header.frame_id, m.pose.position.x) == ("map", 7.0), "the goal in the map"
        )

    def test_topics_are_passed_on_while_somebody_listens(self):
        self.make_sure_of_server()
        relayed = self.relays_to("move_base_flex/global_costmap/costmap")
        self.assertFalse(relayed())
        for _ in range(2):
            costmap = Listener("move_base/global_costmap/costmap", OccupancyGrid)
            grid = costmap.wait_for(lambda m: True, "the costmap")
            self.assertEqual((grid.info.width, list(grid.data)), (2, [0, 100, -1, 50]))
            self.assertTrue(relayed())
            costmap.close()
            wait_until(lambda: not relayed(), "the relay to stop fetching")

    def test_planners_potentials_are_fetched_from_what_the_server_calls_them(self):
        self.make_sure_of_server()
        for name, message, theirs in (("NavfnROS", PointCloud2, "navfn"), ("GlobalPlanner", OccupancyGrid, "GP")):
            potential = Listener(f"move_base/{name}/potential", message)
            wait_until(self.relays_to(f"move_base_flex/{theirs}/potential"), f"the relay to fetch {name}'s")
            potential.close()

    def relays_to(self, topic):
        """Return how to ask the master whether the relay listens to a topic."""
        master, name = rosgraph.Master("relay_test"), rospy.resolve_name(topic)
        return lambda: any(t == name and "/move_base" in nodes for t, nodes in master.getSystemState()[1])

    def test_recoveries_are_told(self):
        self.make_sure_of_server()
        told = Listener("move_base/recovery_status", RecoveryStatus)
        wait_until(self.relays_to("move_base_flex/recovery/goal"), "the relay to listen to recoveries")
        wait_until(lambda: (self.send("recover"), told.last)[1], "recovery_status", period=0.2)
        message = told.last
        self.assertEqual(
            (message.recovery_behavior_name, message.current_recovery_number, message.total_number_of_recoveries),
            ("rotate", 1, 2),
        )
        told.close()


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "relay_face", RelayFaceTest)
