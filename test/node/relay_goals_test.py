#!/usr/bin/env python3
"""The relay's goals: their ends, states and texts, cancelled, replaced, by many at once, and nonsense."""

import os
import sys
import threading

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import actionlib
import rospy
import rostest
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from mbf_msgs import msg as mbf
from mbf_msgs.msg import ExePathResult
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal
from node.relay_case import REPLACED, RelayCase
from ros_testing import Listener, connected_publisher, wait_until

NO_PLAN = "Failed to find a valid plan. Even after executing recovery behaviors."
NO_CONTROL = "Failed to find a valid control. Even after executing recovery behaviors."


class RelayGoalsTest(RelayCase):
    def test_ends_have_move_bases_states_and_texts(self):
        self.make_sure_of_server()
        for script, status, text in (
            ("arrive", GoalStatus.SUCCEEDED, "Goal reached."), ("no_plan", GoalStatus.ABORTED, NO_PLAN),
            ("no_control", GoalStatus.ABORTED, NO_CONTROL),
            ("oscillate", GoalStatus.ABORTED, "Robot is oscillating. Even after executing recovery behaviors."),
            ("reject", GoalStatus.ABORTED, NO_PLAN), ("cancel_unasked", GoalStatus.ABORTED, NO_CONTROL),
            ("wrong_success", GoalStatus.ABORTED, NO_CONTROL), ("empty_result", GoalStatus.ABORTED, NO_PLAN),
        ):
            with self.subTest(script):
                self.check_end(self.send(script), status, text)
        outcome = self.outcomes.wait_for(lambda m: m.result.message == "no command for 5 s", "the outcome")
        self.assertEqual(outcome.result.outcome, ExePathResult.PAT_EXCEEDED)

    def test_an_upside_down_goal_is_aborted_and_the_running_one_stopped(self):
        self.make_sure_of_server()
        running = self.send("drive", x=71.0)
        self.wait_for_feedback(running)
        bad = self.send("drive", quaternion_w=0.0)
        self.check_end(bad, GoalStatus.ABORTED, "Aborting on goal because it was sent with an invalid quaternion")
        self.check_end(running, GoalStatus.PREEMPTED, REPLACED)
        wait_until(lambda: self.reported("cancel drive 71.0"), "the cancel at the server")

    def test_a_stranger_who_says_that_the_robot_has_arrived_is_not_believed(self):
        """Its client was told "Goal reached." and the robot drove on until the goal's lease ran out."""
        self.make_sure_of_server()
        sent = Listener("move_base_flex/move_base/goal", mbf.MoveBaseActionGoal, connected=True)
        # publishes no status; it listens to goals, as a recorder does
        stranger = connected_publisher("move_base_flex/move_base/result", mbf.MoveBaseActionResult, queue_size=10)
        running = self.send("drive", x=73.0)
        self.wait_for_feedback(running)
        goal = sent.wait_for(lambda m: m.goal.target_pose.pose.position.x == 73.0, "the goal at the server")
        for status in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.PREEMPTED):
            stranger.publish(mbf.MoveBaseActionResult(status=GoalStatus(goal_id=goal.goal_id, status=status)))
        self.wait_for_feedback(running, 20)
        self.assertEqual(self.reported("cancel drive 73.0"), [])
        self.cancels.publish(GoalID(id=running))
        self.check_end(running, GoalStatus.PREEMPTED, "")

    def test_feedback_comes_at_the_servers_rate_and_in_order(self):
        self.make_sure_of_server()
        goal_id = self.send("drive", x=5.0)
        self.wait_for_feedback(goal_id, 20)
        self.cancels.publish(GoalID(id=goal_id))
        self.check_end(goal_id, GoalStatus.PREEMPTED, "")
        poses = [m.feedback.base_position for m in self.feedback.messages if m.status.goal_id.id == goal_id]
        ys = [pose.pose.position.y for pose in poses]
        self.assertEqual(ys, [float(i) for i in range(len(ys))])
        self.assertEqual({(pose.header.frame_id, pose.pose.position.x) for pose in poses}, {("map", 5.0)})

    def test_cancel_passes_through_preempting(self):
        self.make_sure_of_server()
        goal_id = self.send("ignore_cancel")
        self.wait_for_feedback(goal_id)
        self.cancels.publish(GoalID(id=goal_id))
        self.wait_for_status(goal_id, GoalStatus.PREEMPTING)
        self.check_end(goal_id, GoalStatus.PREEMPTED, "")

    def test_cancel_by_stamp_and_all_at_once(self):
        self.make_sure_of_server()
        for cancel in (GoalID(stamp=rospy.Time.from_sec(self.now)), GoalID()):
            goal_id = self.send("drive", stamp=self.now)
            self.wait_for_feedback(goal_id)
            self.cancels.publish(cancel)
            self.check_end(goal_id, GoalStatus.PREEMPTED, "")
            self.set_clock(self.now + 1.0)

    def test_a_cancel_before_its_goal_recalls_it_and_the_robot_stands(self):
        self.make_sure_of_server()
        before = self.send("drive")
        self.wait_for_feedback(before)
        self.cancels.publish(GoalID(id="early"))
        self.wait_for_status("early", GoalStatus.RECALLING)
        self.send("drive", goal_id="early")
        self.assertEqual(self.end_of("early").status, GoalStatus.RECALLED)
        self.check_end(before, GoalStatus.PREEMPTED, REPLACED)

    def test_goals_in_one_instant_end_in_the_order_they_came(self):
        self.make_sure_of_server()
        ids = [self.send("drive", x=float(i)) for i in range(30)]
        for goal_id in ids[:-1]:
            self.check_end(goal_id, GoalStatus.PREEMPTED, REPLACED)
        last = self.send("arrive")
        self.check_end(ids[-1], GoalStatus.PREEMPTED, REPLACED)
        self.check_end(last, GoalStatus.SUCCEEDED, "Goal reached.")

    def test_an_older_goal_is_recalled(self):
        self.make_sure_of_server()
        new = self.send("drive")
        self.wait_for_feedback(new)
        self.assertEqual(self.end_of(self.send("drive", stamp=self.now - 1.0)).status, GoalStatus.RECALLED)
        self.cancels.publish(GoalID(id=new))
        self.check_end(new, GoalStatus.PREEMPTED, "")

    def test_twenty_clients_of_actionlib_each_get_an_answer(self):
        self.make_sure_of_server()
        states, lock = [], threading.Lock()

        def client():
            mine = actionlib.ActionClient("move_base", MoveBaseAction)
            wait_until(
                lambda: mine.pub_goal.get_num_connections() and mine.result_sub.get_num_connections(), "move_base"
            )
            goal = MoveBaseGoal()
            goal.target_pose.header.frame_id, goal.target_pose.pose.orientation.w = "map", 1.0
            for _ in range(5):
                handle = mine.send_goal(goal)
                wait_until(lambda: handle.get_comm_state() == actionlib.CommState.DONE, "an answer", 20.0)
                with lock:
                    states.append(handle.get_terminal_state())
            mine.stop()

        threads = [threading.Thread(target=client) for _ in range(20)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(len(states), 100)
        self.assertLessEqual(set(states), {GoalStatus.SUCCEEDED, GoalStatus.PREEMPTED})
        self.assertIn(GoalStatus.SUCCEEDED, states)

    def test_nonsense_breaks_nothing(self):
        self.make_sure_of_server()
        for goal_id in ("", "no such goal"):
            self.cancels.publish(GoalID(id=goal_id, stamp=rospy.Time(0)))
        self.wait_for_status("no such goal", GoalStatus.RECALLING)  # both are taken: goals come by another connection
        count = len(self.results.messages)
        self.send("arrive", goal_id="")
        wait_until(lambda: len(self.results.messages) > count, "the result of a goal without an id")
        status = self.results.last.status
        self.assertEqual((status.status, bool(status.goal_id.id)), (GoalStatus.SUCCEEDED, True))
        self.cancels.publish(GoalID(id=status.goal_id.id))
        storm = rospy.Publisher("move_base_flex/move_base/status", GoalStatusArray, queue_size=1000)
        wait_until(storm.get_num_connections, "the relay to listen")
        for i in range(500):
            storm.publish(GoalStatusArray(status_list=[GoalStatus(goal_id=GoalID(id=f"unknown-{i}"), status=i % 10)]))
        storm.unregister()
        self.check_end(self.send("arrive"), GoalStatus.SUCCEEDED, "Goal reached.")


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "relay_goals", RelayGoalsTest)
