#!/usr/bin/env python3
"""The server's races: goals cancelled at every moment, replaced by the hundred, and a server that is told to end.

The server runs scripted plugins, so that the robot does nothing but what the server makes of them.
"""

import atexit
import itertools
import os
import signal
import subprocess
import sys
import threading
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import rospy
import rostest
from actionlib_msgs.msg import GoalID, GoalStatus
from dynamic_reconfigure.client import Client as ReconfigureClient
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist
from mbf_msgs.msg import (
    ExePathAction,
    ExePathGoal,
    ExePathResult,
    GetPathAction,
    GetPathGoal,
    GetPathResult,
    MoveBaseAction,
    MoveBaseGoal,
    MoveBaseResult,
    RecoveryAction,
    RecoveryGoal,
    RecoveryResult,
)
from nav_msgs.msg import Odometry
from ros_testing import Listener, connected_publisher, wait_until
from tally import LONG

from mbf_relay.ros.common.actions.action_client import ActionClient
from mbf_relay.ros.common.outcome_codes import name_of

SERVER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "paper_server.py")
DELAYS = (0.0, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.5)
"""Seconds from goal to cancel."""
REPETITIONS = 50 if LONG else 2
ACTIONS = {
    "get_path": (GetPathAction, GetPathResult), "exe_path": (ExePathAction, ExePathResult),
    "recovery": (RecoveryAction, RecoveryResult), "move_base": (MoveBaseAction, MoveBaseResult),
}
CANCELLED = (GoalStatus.PREEMPTED, GoalStatus.RECALLED)
STATES = {value: name for name, value in vars(GoalStatus).items() if name.isupper()}


def pose_at(x, y=0.0, frame="map"):
    pose = PoseStamped(pose=Pose(Point(x, y, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0)))
    pose.header.frame_id = frame
    return pose


def is_zero(twist):
    return twist.linear.x == twist.linear.y == twist.angular.z == 0.0


class NavigationTest(unittest.TestCase):
    """Every test leaves the server running and idle."""

    @classmethod
    def setUpClass(cls):
        rospy.init_node("navigation_test")
        cls.velocity = Listener("cmd_vel", Twist)
        cls.odometry = Listener("odom", Odometry)
        cls.clients = {
            name: ActionClient(f"move_base_flex/{name}", types[0]) for name, types in ACTIONS.items()
        }
        rospy.set_param("move_base_flex", {"tf_timeout": 0.3, "script": {"plan_time": 0.03, "recovery_steps": 20}})
        cls.start_server()

    @classmethod
    def start_server(cls):
        cls.server = subprocess.Popen([sys.executable, SERVER])
        atexit.register(cls.server.kill)
        for name, client in cls.clients.items():
            assert client.wait_for_server(60.0), f"waited 60 s for the action {name}, in vain"
        wait_until(lambda: cls.odometry.last, "odometry")

    @classmethod
    def tearDownClass(cls):
        cls.server.terminate()
        try:
            cls.server.wait(20.0)
        except subprocess.TimeoutExpired:
            cls.server.kill()
            raise AssertionError("waited 20 s for the server to end, in vain") from None

    # helpers

    def x(self):
        return self.odometry.last.pose.pose.position.x

    def path_to(self, x):
        goal = ExePathGoal()
        goal.path.header.frame_id = "map"
        start = self.x()
        goal.path.poses = [pose_at(start + (x - start) * step / 10.0) for step in range(11)]
        return goal

    def long_goal(self, action):
        """A goal that takes seconds, or for plans, tens of milliseconds."""
        return {
            "get_path": lambda: GetPathGoal(target_pose=pose_at(3.0)), "exe_path": lambda: self.path_to(self.x() + 5.0),
            "recovery": lambda: RecoveryGoal(behavior="R1"),
            "move_base": lambda: MoveBaseGoal(target_pose=pose_at(self.x() + 5.0)),
        }[action]()

    def short_goal(self, action):
        """A goal that succeeds at once."""
        return {
            "get_path": lambda: GetPathGoal(target_pose=pose_at(1.0)), "exe_path": lambda: self.path_to(self.x()),
            "recovery": lambda: RecoveryGoal(behavior="R2"),
            "move_base": lambda: MoveBaseGoal(target_pose=pose_at(self.x())),
        }[action]()

    def end_of(self, sent, timeout=20.0):
        ending = sent.wait(timeout)
        self.assertIsNotNone(ending, f"waited {timeout} s for the end of goal {sent.goal_id}, in vain")
        return ending

    def await_standing(self):
        """Wait until the last velocity is zero; returns how many there were."""
        wait_until(
            lambda: self.velocity.last is None or is_zero(self.velocity.last), "a zero as the last velocity"
        )
        return len(self.velocity.messages)

    def drove_on(self, since, count):
        """Return whether the robot set out again after it was told to stand.

        A velocity from before the zero may be heard late, after the goal's end and the zero of another goal: a busy
        machine reads one connection before the other.

        Args:
            since: Number of velocities when the goal was sent.
            count: Number of velocities when it had ended.
        """
        moves = [not is_zero(twist) for twist in self.velocity.messages[since:]]
        starts = sum(now and not before for before, now in zip([False] + moves, moves))
        return starts > 1 and any(moves[count - since:])

    def succeed(self, action):
        if action == "recovery":
            rospy.set_param("move_base_flex/script/recovery_steps", 1)
        ending = self.end_of(self.clients[action].send(self.short_goal(action)))
        rospy.set_param("move_base_flex/script/recovery_steps", 20)
        self.assertEqual(STATES[ending.status], "SUCCEEDED", f"{action}: {ending.text}")

    # tests

    def test_1_a_goal_can_be_cancelled_at_any_moment(self):
        pause = threading.Event()
        for action, delay, _ in itertools.product(ACTIONS, DELAYS, range(REPETITIONS)):
            what = f"{action} cancelled after {1000.0 * delay:g} ms"
            since = len(self.velocity.messages)
            sent = self.clients[action].send(self.long_goal(action))
            if delay:
                pause.wait(delay)
            sent.cancel()
            ending = self.end_of(sent)
            # a plan may be done before it is called off, on a busy machine after any delay
            allowed = CANCELLED + ((GoalStatus.SUCCEEDED,) if action == "get_path" else ())
            self.assertIn(ending.status, allowed, f"{what} ended {STATES[ending.status]}: {ending.text}")
            if ending.status in CANCELLED:
                self.assertEqual(name_of(ending.result.outcome, ACTIONS[action][1]), "CANCELED", what)
            count = self.await_standing()
            self.succeed("get_path")
            self.await_standing()
            self.assertFalse(self.drove_on(since, count), f"{what}, and the robot drove on")
        for action in ACTIONS:
            self.succeed(action)

    def test_2_hundreds_of_goals_replace_each_other_and_each_ends_once(self):
        for action in ("get_path", "move_base"):
            messages = ACTIONS[action][0]()
            goal_type, result_type = type(messages.action_goal), type(messages.action_result)
            results = Listener(f"move_base_flex/{action}/result", result_type, connected=True)
            goals = connected_publisher(f"move_base_flex/{action}/goal", goal_type, queue_size=1000)
            names = [f"{action} {index}" for index in range(500)]
            for index, name in enumerate(names):
                goal = self.short_goal(action) if name == names[-1] else self.long_goal(action)
                goals.publish(goal_type(goal_id=GoalID(id=name), goal=goal))
                if index % 50 == 49:  # or this process' own queue, a hundred long, would drop some
                    wait_until(lambda: len(results.messages) >= index - 10, f"{index - 10} results of {action}", 60.0)
            wait_until(lambda: len(results.messages) >= len(names), f"{len(names)} results of {action}", 60.0)
            self.await_standing()
            self.succeed(action)
            wait_until(lambda: len(results.messages) > len(names), "the last result")
            ended = {message.status.goal_id.id: message.status.status for message in results.messages}
            self.assertEqual(len(results.messages), len(names) + 1, "some goal ended twice")
            self.assertEqual(ended.pop(names[-1]), GoalStatus.SUCCEEDED)
            # a plan may be done before the next goal comes, on a busy machine any of them
            may_succeed = (GoalStatus.SUCCEEDED,) if action == "get_path" else ()
            for name in names[:-1]:
                self.assertIn(ended[name], CANCELLED + may_succeed, name)
            self.assertFalse(set(ended.values()).isdisjoint(CANCELLED), "none was replaced")
            results.close()
            goals.unregister()

    def test_3_a_takeover_does_not_stop_the_robot_but_a_cancel_does(self):
        for action in ("exe_path", "move_base"):
            first = self.clients[action].send(self.long_goal(action))
            wait_until(lambda: not is_zero(self.velocity.last or Twist()), "driving")
            count = len(self.velocity.messages)
            second = self.clients[action].send(self.long_goal(action))
            self.assertIn(self.end_of(first).status, CANCELLED)
            wait_until(lambda: len(self.velocity.messages) > count + 5, "more velocities")
            self.assertFalse(
                any(map(is_zero, self.velocity.messages[count:])), f"{action}: the robot stopped in between"
            )
            second.cancel()
            self.assertEqual(self.end_of(second).status, GoalStatus.PREEMPTED)
            self.await_standing()

    def test_4_slots_and_actions_go_on_beside_each_other(self):
        rospy.set_param("move_base_flex/script/plan_time", 0.5)
        plans = [
            self.clients["get_path"].send(GetPathGoal(target_pose=pose_at(2.0), concurrency_slot=s))
            for s in (0, 1, 255)
        ]
        drive = self.clients["exe_path"].send(self.long_goal("exe_path"))
        self.assertEqual([self.end_of(plan).status for plan in plans], [GoalStatus.SUCCEEDED] * 3)
        self.assertIsNone(drive.ending)
        drive.cancel()
        self.end_of(drive)
        rospy.set_param("move_base_flex/script/plan_time", 0.03)

    def test_5_feedback_tells_of_every_cycle_and_rates_change_at_run_time(self):
        client = ReconfigureClient("move_base_flex", timeout=20.0)
        medians = []
        for frequency in (2.5, 50.0):
            client.update_configuration({"controller_frequency": frequency, "oscillation_timeout": 0.0})
            feedback, count = [], len(self.velocity.messages)
            sent = self.clients["exe_path"].send(self.long_goal("exe_path"), on_feedback=feedback.append)
            wait_until(lambda: len(feedback) > 10, "feedback")
            stamps = [entry.last_cmd_vel.header.stamp.to_sec() for entry in feedback]
            steps = sorted(after - before for before, after in zip(stamps, stamps[1:]))
            medians.append(steps[len(steps) // 2])
            self.assertGreater(len(self.velocity.messages), count)
            self.assertEqual(feedback[-1].current_pose.header.frame_id, "map")
            sent.cancel()
            self.end_of(sent)
        self.assertLess(medians[1], medians[0] / 4.0)
        self.assertEqual(client.update_configuration({"restore_defaults": True})["controller_frequency"], 10.0)
        client.close()

    def test_6_a_path_of_a_hundred_thousand_poses_is_driven_along(self):
        goal = self.path_to(self.x() + 5.0)
        goal.path.poses = [pose_at(self.x() + 5.0 * step / 1e5) for step in range(100001)]
        feedback = []
        sent = self.clients["exe_path"].send(goal, on_feedback=feedback.append)
        wait_until(lambda: feedback, "the first cycle along it", 60.0)
        sent.cancel()
        self.assertEqual(self.end_of(sent).status, GoalStatus.PREEMPTED)
        self.await_standing()

    def test_7_told_to_end_the_server_leaves_the_robot_standing_and_no_goal_open(self):
        for how in (signal.SIGINT, signal.SIGTERM):
            drive = self.clients["move_base"].send(self.long_goal("move_base"))
            wait_until(lambda: not is_zero(self.velocity.last or Twist()), "driving")
            self.server.send_signal(how)
            self.server.wait(20.0)
            self.await_standing()
            ending = self.end_of(drive)
            self.assertEqual(STATES[ending.status], "ABORTED")
            self.assertIn("shutting down", ending.text)
            self.odometry.messages.clear()  # the next robot of paper is at the start
            self.start_server()
            self.succeed("move_base")


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "navigation", NavigationTest)
