#!/usr/bin/env python3
"""The relay node between move_base's clients and a scripted server that can be killed.

The test drives /clock itself, and mostly does not: what the relay does must not depend on it.
"""

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import actionlib
import rospy
import rostest
import tf2_ros
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from dynamic_reconfigure.client import Client as ReconfigureClient
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist
from mbf_msgs.msg import ExePathResult, MoveBaseActionResult
from move_base_msgs.msg import (MoveBaseAction, MoveBaseActionFeedback, MoveBaseActionGoal, MoveBaseActionResult as Result,
                                MoveBaseGoal, RecoveryStatus)
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetPlan, GetPlanRequest
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String
from std_srvs.srv import Empty

from node.scripted_server import SCRIPTS
from ros_testing import Listener, connected_publisher, wait_until

SERVER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "scripted_server.py")
NO_PLAN = "Failed to find a valid plan. Even after executing recovery behaviors."
NO_CONTROL = "Failed to find a valid control. Even after executing recovery behaviors."
REPLACED = "This goal was canceled because another goal was recieved by the simple action server"


@contextlib.contextmanager
def started(executable, *arguments):
    """Run a node of the package as `move_base`; end it in the end."""
    process = subprocess.Popen(["rosrun", "mbf_relay", executable, *arguments])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


class RelayTest(unittest.TestCase):
    """All in one process: connections cost more than what is tested."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("relay_test")
        cls.clock = rospy.Publisher("/clock", Clock, queue_size=1)
        cls.server = None
        rospy.set_param("move_base_flex/planners", [
            {"name": "navfn", "type": "navfn/NavfnROS"}, {"name": "GP", "type": "global_planner/GlobalPlanner"}])
        rospy.set_param("move_base_flex/recovery_behaviors", [
            {"name": "clear", "type": "x"}, {"name": "rotate", "type": "y"}])
        cls.report = Listener("move_base_flex/report", String)
        cls.results = Listener("move_base/result", Result)
        cls.status = Listener("move_base/status", GoalStatusArray, connected=True)
        cls.feedback = Listener("move_base/feedback", MoveBaseActionFeedback)
        cls.outcomes = Listener("move_base/navigation_outcome", MoveBaseActionResult)
        cls.velocity = Listener("cmd_vel", Twist, connected=True)
        cls.current_goal = Listener("move_base/current_goal", PoseStamped, connected=True)
        cls.goals = connected_publisher("move_base/goal", MoveBaseActionGoal, queue_size=100)
        cls.cancels = connected_publisher("move_base/cancel", GoalID, queue_size=100)
        cls.number = 0
        cls.set_clock(100.0)
        cls.start_server()

    def setUp(self):
        self.set_clock(self.now + 10.0)

    @classmethod
    def tearDownClass(cls):
        cls.kill_server()

    @classmethod
    def set_clock(cls, seconds):
        cls.now = seconds
        message = Clock(rospy.Time.from_sec(seconds))

        def arrived():
            cls.clock.publish(message)
            told = cls.status.last  # the relay stamps it with what it takes for now
            return rospy.get_time() == seconds and told is not None and told.header.stamp.to_sec() == seconds

        wait_until(arrived, f"the clock to stand at {seconds}")

    @classmethod
    def start_server(cls):
        cls.server = subprocess.Popen([sys.executable, SERVER])
        wait_until(lambda: cls.report._subscriber.get_num_connections(), "the server's report")

    @classmethod
    def kill_server(cls):
        if cls.server is not None:
            cls.server.kill()
            cls.server.wait()
            cls.server = None

    def make_sure_of_server(self):
        """Have a server that carries out goals."""
        if self.server is None or self.server.poll() is not None:
            wait_until(lambda: not self.report._subscriber.get_num_connections(), "the old server's end")
            self.start_server()

    def send(self, script, x=0.0, goal_id=None, stamp=None, quaternion_w=1.0, frame="map", goals=None):
        """Send an action goal and return its id."""
        type(self).number += 1
        message = MoveBaseActionGoal()
        message.goal_id.id = f"goal-{self.number}" if goal_id is None else goal_id
        message.goal_id.stamp = rospy.Time.from_sec(self.now if stamp is None else stamp)
        pose = message.goal.target_pose
        pose.header.frame_id, pose.pose.position.x, pose.pose.position.z = frame, x, SCRIPTS[script]
        pose.pose.orientation.w = quaternion_w
        (goals or self.goals).publish(message)
        return message.goal_id.id

    def end_of(self, goal_id, timeout=10.0):
        """Wait for a goal's result and return its status."""
        return self.results.wait_for(lambda m: m.status.goal_id.id == goal_id, f"the result of {goal_id}", timeout).status

    def wait_for_status(self, goal_id, status):
        self.status.wait_for(
            lambda m: any(s.goal_id.id == goal_id and s.status == status for s in m.status_list),
            f"{goal_id} in state {GoalStatus.to_string(status)}", 10.0)

    def wait_for_feedback(self, goal_id, count=1):
        wait_until(lambda: len([m for m in self.feedback.messages if m.status.goal_id.id == goal_id]) >= count,
                   f"{count} feedback of {goal_id}", 10.0)

    def reported(self, *words):
        return [m.data for m in self.report.messages if all(str(word) in m.data for word in words)]

    def check_end(self, goal_id, status, text, timeout=10.0):
        end = self.end_of(goal_id, timeout)
        self.assertEqual((GoalStatus.to_string(end.status), end.text), (GoalStatus.to_string(status), text))

    # --- goals and their ends ---

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

    def test_a_cancel_before_its_goal_recalls_it(self):
        self.cancels.publish(GoalID(id="early"))
        self.wait_for_status("early", GoalStatus.RECALLING)
        self.send("drive", goal_id="early")
        self.assertEqual(self.end_of("early").status, GoalStatus.RECALLED)

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
            wait_until(lambda: mine.pub_goal.get_num_connections() and mine.result_sub.get_num_connections(), "move_base")
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
        for goal_id in ("no such goal", ""):
            self.cancels.publish(GoalID(id=goal_id, stamp=rospy.Time(0)))
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

    # --- the server's life and the clock's ---

    def test_a_goal_waits_for_the_server_but_not_for_ever(self):
        self.kill_server()
        wait_until(lambda: not self.report._subscriber.get_num_connections(), "the server's end")
        end = self.end_of(self.send("arrive"))
        if "died" in end.text:  # the relay had not noticed yet when the goal came
            end = self.end_of(self.send("arrive"))
        self.assertIn("'move_base_flex' within 3 s", end.text)
        waiting = self.send("arrive")
        self.wait_for_status(waiting, GoalStatus.ACTIVE)
        self.start_server()
        self.check_end(waiting, GoalStatus.SUCCEEDED, "Goal reached.")

    def test_a_killed_server_is_noticed_while_the_clock_stands(self):
        self.make_sure_of_server()
        goal_id = self.send("drive")
        self.wait_for_feedback(goal_id)
        stops, start = len(self.velocity.messages), time.monotonic()
        self.server.send_signal(signal.SIGKILL)
        end = self.end_of(goal_id)
        self.assertLess(time.monotonic() - start, 2.0)
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
        self.server.send_signal(signal.SIGSTOP)
        try:
            end = self.end_of(goal_id, 15.0)
        finally:
            self.server.send_signal(signal.SIGCONT)
        self.assertEqual(end.status, GoalStatus.ABORTED)
        self.assertIn("hangs", end.text)
        wait_until(lambda: self.reported("cancel drive 61.0"), "the cancel of what was given up")
        self.check_end(self.send("arrive"), GoalStatus.SUCCEEDED, "Goal reached.")

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

    # --- what else a move_base has ---

    def test_a_simple_goal_is_an_action_goal_that_anyone_can_cancel(self):
        self.make_sure_of_server()
        seen = Listener("move_base/goal", MoveBaseActionGoal)
        simple = connected_publisher("move_base_simple/goal", PoseStamped)
        wait_until(lambda: seen._subscriber.get_num_connections() >= 2, "both publishers of action goals")
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

    def test_costmaps_are_cleared_at_the_server(self):
        self.make_sure_of_server()
        rospy.ServiceProxy("move_base/clear_costmaps", Empty)()
        wait_until(lambda: self.reported("clear"), "the request at the server")

    def test_changes_of_parameters_and_nothing_else_reach_the_server(self):
        self.make_sure_of_server()
        wait_until(lambda: self.reported("reconfigure", "planner_patience", "9.0"), "the patience set at start")
        client = ReconfigureClient("move_base", timeout=10)
        wait_until(lambda: client.get_configuration()["controller_frequency"] == 10.0, "the server's own frequency")
        client.update_configuration({"max_planning_retries": 4, "conservative_reset_dist": 1.0})
        wait_until(lambda: self.reported("reconfigure [('planner_max_retries', 4)]"), "the change")
        self.check_end(self.send("arrive", x=81.0), GoalStatus.SUCCEEDED, "Goal reached.")
        self.assertTrue(self.reported("goal arrive 81.0 GP"))
        client.update_configuration({"base_global_planner": "navfn/NavfnROS"})
        self.check_end(self.send("arrive", x=82.0), GoalStatus.SUCCEEDED, "Goal reached.")
        self.assertTrue(self.reported("goal arrive 82.0 navfn"))
        refused = client.update_configuration({"base_global_planner": "carrot_planner/CarrotPlanner"})
        self.assertEqual(refused["base_global_planner"], "navfn/NavfnROS")
        self.assertFalse(self.reported("controller_frequency"))
        client.update_configuration({"base_global_planner": "global_planner/GlobalPlanner"})
        client.close()

    def test_a_goal_in_another_frame_is_shown_in_the_map(self):
        self.make_sure_of_server()
        broadcaster = tf2_ros.StaticTransformBroadcaster()
        transform = TransformStamped()
        transform.header.frame_id, transform.child_frame_id = "map", "base_link"
        transform.transform.translation.x, transform.transform.rotation.w = 5.0, 1.0
        broadcaster.sendTransform(transform)
        self.check_end(self.send("arrive", x=2.0, frame="base_link"), GoalStatus.SUCCEEDED, "Goal reached.")
        self.current_goal.wait_for(lambda m: (m.header.frame_id, m.pose.position.x) == ("map", 7.0), "the goal in the map")

    def test_a_relay_that_is_stopped_cancels_and_says_so(self):
        self.make_sure_of_server()
        results = Listener("second/move_base/result", Result)
        with started("move_base_relay", "__ns:=second", "_server:=/move_base_flex") as relay:
            goals = connected_publisher("second/move_base/goal", MoveBaseActionGoal)
            wait_until(results._subscriber.get_num_connections, "the second relay")
            self.send("drive", x=91.0, goals=goals)
            wait_until(lambda: self.reported("goal drive 91.0"), "the goal at the server")
            relay.send_signal(signal.SIGINT)
            end = results.wait_for(lambda m: True, "the end").status
            self.assertEqual((end.status, end.text),
                             (GoalStatus.ABORTED, "Aborting on the goal because the node has been killed"))
            wait_until(lambda: self.reported("cancel drive 91.0"), "the cancel at the server")
            self.assertEqual(relay.wait(20.0), 0)

    def test_the_goal_topic_alone(self):
        self.make_sure_of_server()
        outcomes = Listener("third/move_base/navigation_outcome", MoveBaseActionResult)
        with started("mb_relay_subscriber.py", "__ns:=third", "_server:=/move_base_flex"):
            simple = connected_publisher("third/move_base_simple/goal", PoseStamped)
            wait_until(outcomes._subscriber.get_num_connections, "the third relay")
            for number, script in enumerate(("drive", "no_plan", "arrive")):
                if number == 2:
                    outcomes.wait_for(lambda m: True, "the outcomes of the first two", since=1)
                pose = PoseStamped()
                pose.header.frame_id, pose.header.stamp = "map", rospy.Time.from_sec(self.now + number)
                pose.pose.position.z, pose.pose.orientation.w = SCRIPTS[script], 1.0
                simple.publish(pose)
            topics = [name for name, _ in rospy.get_published_topics("/third")]
            ends = [outcomes.wait_for(lambda m: True, f"outcome {i + 1}", since=i) for i in range(3)]
            self.assertNotIn("/third/move_base/status", topics)
        self.assertEqual([end.status.status for end in ends], [GoalStatus.PREEMPTED, GoalStatus.ABORTED, GoalStatus.SUCCEEDED])

    def test_the_tutorials_clients_tell_by_their_exit_status(self):
        self.make_sure_of_server()
        self.assertIn("Drove circle with result: True", self.run_client("mb_relay_client.py", 0))
        self.assertIn("Drove circle with result: True", self.run_client("mb_relay_client.py", 0, "--via", "topic"))
        self.assertIn("Drove circle with result: True", self.run_client("mbf_goal_client.py", 0))
        self.run_client("movebase_client.py", 2, "nan")
        self.kill_server()
        self.assertIn("within 3 s", self.run_client("movebase_client.py", 1))

    def run_client(self, name, status, *arguments):
        """Run a client, check its exit status and return what it said."""
        done = subprocess.run(["rosrun", "mbf_relay", name, *arguments], stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                              timeout=60.0, universal_newlines=True)
        self.assertEqual(done.returncode, status, done.stdout)
        return done.stdout

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

    def relays_to(self, topic):
        """Return how to ask the master whether the relay listens to a topic."""
        import rosgraph

        master, name = rosgraph.Master("relay_test"), rospy.resolve_name(topic)
        return lambda: any(t == name and "/move_base" in nodes for t, nodes in master.getSystemState()[1])

    def test_recoveries_are_told(self):
        self.make_sure_of_server()
        told = Listener("move_base/recovery_status", RecoveryStatus)
        wait_until(self.relays_to("move_base_flex/recovery/goal"), "the relay to listen to recoveries")
        wait_until(lambda: (self.send("recover"), told.last)[1], "recovery_status", period=0.2)
        message = told.last
        self.assertEqual((message.recovery_behavior_name, message.current_recovery_number, message.total_number_of_recoveries),
                         ("rotate", 1, 2))
        told.close()


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "relay", RelayTest)
