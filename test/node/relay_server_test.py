#!/usr/bin/env python3
"""The relay in front of this package's server, which moves a robot of paper."""

import contextlib
import math
import os
import signal
import subprocess
import sys
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import actionlib
import psutil
import rosgraph
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from benchmark.processes import node_pid
from dynamic_reconfigure.client import Client as ReconfigureClient
from geometry_msgs.msg import Twist
from mbf_msgs.msg import MoveBaseActionResult
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal, RecoveryStatus
from nav_msgs.msg import Odometry
from nav_msgs.srv import GetPlan, GetPlanRequest
from ros_testing import Listener, freeze, wait_until

NO_PLAN = "Failed to find a valid plan. Even after executing recovery behaviors."


class RelayServerTest(unittest.TestCase):
    """Everything a client of move_base can do, and what it is told."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("relay_server_test")
        cls.client = actionlib.ActionClient("move_base", MoveBaseAction)
        cls.odometry = Listener("odom", Odometry, connected=True)
        cls.velocity = Listener("cmd_vel", Twist, connected=True)
        cls.outcomes = Listener("move_base/navigation_outcome", MoveBaseActionResult, connected=True)
        wait_until(lambda: cls.client.pub_goal.get_num_connections() and cls.client.result_sub.get_num_connections(),
                   "the action move_base")

    def setUp(self):
        self.feedback = []

    def send(self, x, y, frame="map", w=1.0):
        goal = MoveBaseGoal()
        goal.target_pose.header.frame_id, goal.target_pose.header.stamp = frame, rospy.Time.now()
        goal.target_pose.pose.position.x, goal.target_pose.pose.position.y = x, y
        goal.target_pose.pose.orientation.w = w
        return self.client.send_goal(goal, feedback_cb=lambda _, feedback: self.feedback.append(feedback.base_position))

    def check_end(self, handle, status, text, timeout=20.0):
        wait_until(lambda: handle.get_comm_state() == actionlib.CommState.DONE, "the goal's end", timeout)
        self.assertEqual((GoalStatus.to_string(handle.get_terminal_state()), handle.get_goal_status_text()),
                         (GoalStatus.to_string(status), text))

    def wait_until_driving(self):
        wait_until(lambda: self.feedback, "feedback")
        wait_until(lambda: abs(self.odometry.last.twist.twist.linear.x) > 0.01, "the robot to drive")

    @property
    def x(self):
        return self.odometry.last.pose.pose.position.x

    def test_a_goal_is_reached(self):
        target = self.x + 0.5
        self.check_end(self.send(target, 0.0), GoalStatus.SUCCEEDED, "Goal reached.")
        self.assertLess(abs(self.x - target), 0.1)
        self.assertEqual({pose.header.frame_id for pose in self.feedback}, {"map"})
        xs = [pose.pose.position.x for pose in self.feedback]
        self.assertEqual(xs, sorted(xs), "frames came out of order")

    def test_cancel_stops_the_robot(self):
        handle = self.send(self.x + 50.0, 0.0)
        self.wait_until_driving()
        handle.cancel()
        self.check_end(handle, GoalStatus.PREEMPTED, "")
        wait_until(lambda: self.odometry.last.twist.twist == Twist(), "the robot to stand")
        wait_until(lambda: self.velocity.last == Twist(), "a zero as the last velocity")

    def test_the_newest_of_many_goals_wins(self):
        target = self.x + 0.3
        # Fewer than the ten that actionlib's client keeps for sending: an eleventh drops the first on a busy machine.
        handles = [self.send(self.x + 50.0, 0.0) for _ in range(8)] + [self.send(target, 0.0)]
        self.check_end(handles[-1], GoalStatus.SUCCEEDED, "Goal reached.")
        for handle in handles[:-1]:
            self.check_end(handle, GoalStatus.PREEMPTED,
                           "This goal was canceled because another goal was recieved by the simple action server")

    def test_a_plan_is_made_from_the_robot_while_it_drives(self):
        handle = self.send(self.x + 50.0, 0.0)
        self.wait_until_driving()
        request = GetPlanRequest()  # as rosservice makes it: an empty start frame, all quaternions zero
        request.goal.header.frame_id, request.goal.pose.position.x = "map", -3.0
        before = self.x
        poses = rospy.ServiceProxy("move_base/make_plan", GetPlan)(request).plan.poses
        self.assertTrue(before - 0.1 < poses[0].pose.position.x < self.x + 0.3, (before, poses[0].pose.position.x))
        self.assertAlmostEqual(poses[-1].pose.position.x, -3.0, places=3)
        driven = self.x
        wait_until(lambda: self.x > driven + 0.05, "the robot to drive on")
        handle.cancel()
        self.check_end(handle, GoalStatus.PREEMPTED, "")

    def test_as_typed_in_a_shell(self):
        plan = shell(
            "rosservice", "call", "/move_base/make_plan", "{goal: {header: {frame_id: map}, pose: {position: {x: 2}}}}"
        )
        self.assertIn("frame_id: \"map\"", plan)
        self.assertIn("poses:", shell("rosservice", "call", "/move_base/make_plan", "{}"))
        count, target = len(self.outcomes.messages), self.x + 0.2
        shell("rostopic", "pub", "-1", "/move_base_simple/goal", "geometry_msgs/PoseStamped",
              f"{{header: {{frame_id: map}}, pose: {{position: {{x: {target}}}, orientation: {{w: 1}}}}}}")
        outcome = self.outcomes.wait_for(lambda m: True, "the outcome", since=count)
        self.assertEqual(outcome.status.text, "Goal reached.")

    def test_nonsense_moves_nothing(self):
        wait_until(lambda: self.odometry.last.twist.twist == Twist(), "the robot to stand")
        before = self.x
        for goal in (dict(x=math.nan, y=0.0), dict(x=1.0, y=math.inf)):
            self.check_end(self.send(**goal), GoalStatus.ABORTED, NO_PLAN, 30.0)
        self.check_end(self.send(1.0, 0.0, w=0.0), GoalStatus.ABORTED,
                       "Aborting on goal because it was sent with an invalid quaternion")
        self.assertEqual(self.x, before)

    def test_a_frame_nobody_knows_fails_like_any_plan(self):
        for frame in ("nowhere", ""):
            self.check_end(self.send(1.0, 0.0, frame=frame), GoalStatus.ABORTED, NO_PLAN, 30.0)

    def test_recoveries_and_the_servers_reason_are_told(self):
        told = Listener("move_base/recovery_status", RecoveryStatus, connected=True)
        wait_until(lambda: told_by_server("/move_base_flex/recovery_status"), "the relay to listen to the server")
        rospy.set_param("move_base_flex/script/plan_time", 3.0)
        try:
            self.check_end(self.send(1.0, 0.0), GoalStatus.ABORTED, NO_PLAN, 40.0)
        finally:
            rospy.set_param("move_base_flex/script/plan_time", 0.005)
        wait_until(lambda: len(told.messages) > 1, "both recoveries to be told, which come another way than the end")
        self.assertEqual([(m.recovery_behavior_name, m.current_recovery_number, m.total_number_of_recoveries)
                          for m in told.messages], [("R1", 0, 2), ("R2", 1, 2)])
        self.assertEqual(told.last.pose_stamped.header.frame_id, "map")
        reason = self.outcomes.wait_for(lambda m: "patience" in m.result.message.lower(),
                                        "the server's reason")
        self.assertEqual(reason.status.text, NO_PLAN)

    def test_parameters_arrive_at_the_server(self):
        mine, servers = ReconfigureClient("move_base", timeout=10), ReconfigureClient("move_base_flex", timeout=10)
        before = servers.get_configuration()
        mine.update_configuration({"oscillation_timeout": 17.0, "max_planning_retries": 2})
        wait_until(lambda: servers.get_configuration()["oscillation_timeout"] == 17.0, "the server's new value")
        after = servers.get_configuration()
        changed = {name for name in after if name != "groups" and after[name] != before[name]}
        self.assertEqual(changed, {"oscillation_timeout", "planner_max_retries"})
        mine.update_configuration({"oscillation_timeout": before["oscillation_timeout"], "max_planning_retries": -1})
        wait_until(
            lambda: servers.get_configuration()["oscillation_timeout"] == before["oscillation_timeout"], "it back"
        )
        mine.close()
        servers.close()

    def test_a_plan_asked_of_a_server_that_hangs_is_not_waited_for_a_minute(self):
        make_plan = rospy.ServiceProxy("move_base/make_plan", GetPlan)
        request = GetPlanRequest()
        request.goal.header.frame_id, request.goal.pose.position.x = "map", self.x + 1.0

        def plans():
            with contextlib.suppress(rospy.ServiceException):
                return make_plan(request).plan.poses

        wait_until(plans, "a plan")
        server = psutil.Process(node_pid("/move_base_flex", rospy.get_name()))
        freeze(server)
        try:
            with self.assertRaisesRegex(rospy.ServiceException, "/move_base_flex.* hangs"):
                make_plan(request)
        finally:
            server.send_signal(signal.SIGCONT)
        wait_until(plans, "a plan after the thaw")

    def test_the_servers_death_and_return(self):
        handle = self.send(self.x + 50.0, 0.0)
        self.wait_until_driving()
        os.kill(node_pid("/move_base_flex", rospy.get_name()), signal.SIGKILL)
        wait_until(lambda: handle.get_comm_state() == actionlib.CommState.DONE, "the goal's end", 10.0)
        self.assertEqual(handle.get_terminal_state(), GoalStatus.ABORTED)
        self.assertIn("died", handle.get_goal_status_text())
        wait_until(lambda: self.velocity.last == Twist(), "zero velocity")
        handle = self.send(0.3, 0.0)  # the robot of paper starts anew with the server
        self.check_end(handle, GoalStatus.SUCCEEDED, "Goal reached.", 40.0)


def shell(*command):
    """Run a command and return what it says."""
    return subprocess.run(command, stdout=subprocess.PIPE, check=True, timeout=30.0, text=True).stdout


def told_by_server(topic):
    """Return whether the relay listens to a topic of the server's."""
    return any(name == topic and "/move_base" in nodes
               for name, nodes in rosgraph.Master(rospy.get_name()).getSystemState()[1])


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "relay_server", RelayServerTest)
