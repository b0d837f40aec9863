#!/usr/bin/env python3
"""The relay whose server is late, dies, hangs or comes back, and whose clock stands or is set back."""

import os
import signal
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import rospy
import rostest
from actionlib_msgs.msg import GoalID, GoalStatus
from geometry_msgs.msg import Twist
from nav_msgs.srv import GetPlan, GetPlanRequest
from node.relay_case import REPLACED, RelayCase
from ros_testing import freeze, wait_until
from std_srvs.srv import Empty


class RelayLostServerTest(RelayCase):
    def test_a_goal_waits_for_the_server_but_not_for_ever(self):
        self.kill_server()
        wait_until(lambda: not self.report._subscriber.get_num_connections(), "the server's end")
        end = self.end_of(self.send("arrive"), 25.0)
        if "died" in end.text:  # the relay had not noticed yet when the goal came
            end = self.end_of(self.send("arrive"), 25.0)
        self.assertIn("'/move_base_flex' within 15 s", end.text)
        waiting = self.send("arrive")
        self.wait_for_status(waiting, GoalStatus.ACTIVE)
        self.start_server()
        self.check_end(waiting, GoalStatus.SUCCEEDED, "Goal reached.")

    def test_a_killed_server_is_noticed_while_the_clock_stands(self):
        self.make_sure_of_server()
        goal_id = self.send("drive")
        self.wait_for_feedback(goal_id)
        stops = len(self.velocity.messages)
        self.server.send_signal(signal.SIGKILL)
        end = self.end_of(goal_id)
        self.assertEqual(end.status, GoalStatus.ABORTED)
        self.assertIn("/move_base_flex", end.text)
        self.assertIn("died", end.text)
        wait_until(lambda: len(self.velocity.messages) > stops, "zero velocity")
        self.assertEqual(self.velocity.last, Twist())
        self.make_sure_of_server()
        self.check_end(self.send("arrive"), GoalStatus.SUCCEEDED, "Goal reached.")

    def test_a_server_that_dies_of_a_goal_is_no_obstacle_to_the_next(self):
        for _ in range(2):
            self.make_sure_of_server()
            self.assertEqual(self.end_of(self.send("die")).status, GoalStatus.ABORTED)
            self.server.wait()

    def test_a_frozen_server_is_noticed(self):
        self.make_sure_of_server()
        goal_id = self.send("drive", x=61.0)
        self.wait_for_feedback(goal_id)
        stops = len(self.velocity.messages)
        freeze(self.server)
        try:
            end = self.end_of(goal_id, 15.0)
            wait_until(lambda: len(self.velocity.messages) > stops, "zero velocity while it is frozen")
        finally:
            self.server.send_signal(signal.SIGCONT)
        self.assertEqual(self.velocity.last, Twist())
        self.assertEqual(end.status, GoalStatus.ABORTED)
        self.assertIn("hangs", end.text)
        wait_until(lambda: self.reported("cancel drive 61.0"), "the cancel of what was given up")
        self.check_end(self.send("arrive"), GoalStatus.SUCCEEDED, "Goal reached.")

    def test_services_of_a_frozen_server_end_and_say_what_hangs(self):
        self.make_sure_of_server()
        make_plan = rospy.ServiceProxy("move_base/make_plan", GetPlan)
        clear = rospy.ServiceProxy("move_base/clear_costmaps", Empty)
        request = GetPlanRequest()
        request.goal.header.frame_id = "map"
        wait_until(lambda: answered(lambda: make_plan(request)), "a plan")
        before = len(self.reported("clear"))
        clear()
        cleared = wait_until(
            lambda: len(self.reported("clear")) > before and len(self.reported("clear")), "word of the clearing"
        )
        freeze(self.server)
        try:
            for call in (lambda: make_plan(request), lambda: make_plan(request), clear, clear):
                with self.assertRaisesRegex(rospy.ServiceException, "/move_base_flex.* hangs"):
                    call()
        finally:
            self.server.send_signal(signal.SIGCONT)
        wait_until(lambda: len(self.reported("clear")) > cleared, "the clearing that was asked for")
        clear()  # which is the one that hung, where that has not ended yet
        clear()
        plans = len(self.reported("plan"))
        wait_until(lambda: answered(lambda: make_plan(request)), "a plan after the thaw")
        wait_until(lambda: len(self.reported("plan")) > plans, "word of the plan, before which all clearings are told")
        self.assertIn(len(self.reported("clear")) - cleared, (2, 3), "the two that hung are one request to the server")

    def test_services_without_a_server_say_so(self):
        self.kill_server()
        wait_until(lambda: not self.report._subscriber.get_num_connections(), "the server's end")
        for name, kind in (("make_plan", GetPlan), ("clear_costmaps", Empty)):
            with self.assertRaisesRegex(
                rospy.ServiceException, "/move_base_flex/.*(not there|died|unavailable|refused)"
            ):
                rospy.ServiceProxy(f"move_base/{name}", kind)()

    def test_a_clock_that_stands_or_is_set_back_loses_nothing(self):
        self.make_sure_of_server()
        goal_id = self.send("drive")
        self.wait_for_feedback(goal_id)
        for seconds in (self.now + 1000.0, 1.0, 2.0):
            self.set_clock(seconds)
            old, goal_id = goal_id, self.send("drive")
            self.check_end(old, GoalStatus.PREEMPTED, REPLACED)
            self.wait_for_feedback(goal_id)
        count = len(self.status.messages)
        wait_until(lambda: len(self.status.messages) > count + 10, "status while the clock stands", 10.0)
        self.assertFalse(any(m.status.goal_id.id == goal_id for m in self.results.messages))
        self.cancels.publish(GoalID())
        self.check_end(goal_id, GoalStatus.PREEMPTED, "")


def answered(call):
    """Return whether a service answers."""
    try:
        return call() is not None
    except rospy.ServiceException:
        return False


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "relay_lost_server", RelayLostServerTest)
