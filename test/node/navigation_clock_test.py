#!/usr/bin/env python3
"""The server on a clock that stands still and jumps back: goals can be cancelled, plans made, and drives go on."""

import os
import subprocess
import sys
import threading
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, Twist
from mbf_msgs.msg import GetPathAction, GetPathGoal, MoveBaseAction, MoveBaseGoal
from nav_msgs.msg import Odometry
from ros_testing import Listener, wait_until
from rosgraph_msgs.msg import Clock

from mbf_relay.ros.common.actions.action_client import ActionClient

SERVER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "paper_server.py")


def pose_at(x):
    pose = PoseStamped()
    pose.header.frame_id = "map"
    pose.pose.position.x, pose.pose.orientation.w = x, 1.0
    return pose


def moves(twist):
    return twist is not None and twist.linear.x != 0.0


class ClockTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.time, cls.running, cls.over = 1000.0, True, threading.Event()
        cls.clock = rospy.Publisher("/clock", Clock, queue_size=10)
        threading.Thread(target=cls.tick, daemon=True).start()
        rospy.set_param("move_base_flex", {"cmd_vel_ignored_tolerance": 0.0})
        cls.velocity, cls.odometry = Listener("cmd_vel", Twist), Listener("odom", Odometry)
        cls.move_base = ActionClient("move_base_flex/move_base", MoveBaseAction)
        cls.get_path = ActionClient("move_base_flex/get_path", GetPathAction)
        cls.server = subprocess.Popen([sys.executable, SERVER])
        for client in (cls.move_base, cls.get_path):
            assert client.wait_for_server(60.0), f"waited 60 s for {client.name}, in vain"
        wait_until(lambda: cls.odometry.last, "odometry")

    @classmethod
    def tearDownClass(cls):
        cls.over.set()
        cls.server.kill()

    @classmethod
    def tick(cls):
        while not cls.over.wait(0.01) and not rospy.is_shutdown():
            if cls.running:
                cls.time += 0.01
                cls.clock.publish(Clock(rospy.Time.from_sec(cls.time)))

    def drive(self, feedback=None):
        x = self.odometry.last.pose.pose.position.x
        count = len(self.velocity.messages)
        sent = self.move_base.send(MoveBaseGoal(target_pose=pose_at(x + 5.0)), on_feedback=feedback)
        wait_until(lambda: any(map(moves, self.velocity.messages[count:])), "driving")
        return sent

    def test_1_while_the_clock_stands_a_cancel_stops_the_robot_and_plans_are_made(self):
        sent = self.drive()
        type(self).running = False
        try:
            wait_until(lambda: rospy.get_time() >= self.time - 1e-6, "the last tick")
            sent.cancel()
            self.assertEqual(sent.wait(10.0).status, GoalStatus.PREEMPTED)
            wait_until(lambda: not moves(self.velocity.last), "a zero as the last velocity")
            self.assertEqual(
                self.get_path.send(GetPathGoal(target_pose=pose_at(1.0))).wait(10.0).status, GoalStatus.SUCCEEDED
            )
        finally:
            type(self).running = True

    def test_2_a_drive_survives_a_clock_that_is_set_back(self):
        feedback = []
        sent = self.drive(feedback.append)
        type(self).time -= 500.0
        wait_until(lambda: rospy.get_time() < 900.0, "the earlier time")
        feedback.clear()
        wait_until(
            lambda: len([entry for entry in feedback if moves(entry.last_cmd_vel.twist)]) > 5, "cycles after the jump"
        )
        self.assertLess(feedback[-1].last_cmd_vel.header.stamp.to_sec(), 900.0)
        self.assertIsNone(sent.ending)
        sent.cancel()
        self.assertEqual(sent.wait(10.0).status, GoalStatus.PREEMPTED)
        wait_until(lambda: not moves(self.velocity.last), "a zero as the last velocity")

    def test_3_while_the_clock_stands_the_robot_does_and_the_drive_goes_on_with_it(self):
        sent = self.drive()
        count = len(self.velocity.messages)
        type(self).running = False
        try:
            wait_until(lambda: self.velocity.messages[count:] and not moves(self.velocity.last), "a zero")
            wait_until(lambda: self.odometry.last.twist.twist.linear.x == 0.0, "the wheels to stand")
            stopped_at = self.odometry.last.pose.pose.position.x
            more = len(self.odometry.messages) + 50
            wait_until(lambda: len(self.odometry.messages) > more, "a second and a half to go by")
            self.assertEqual(self.odometry.last.pose.pose.position.x, stopped_at)
            self.assertIsNone(sent.ending)
        finally:
            type(self).running = True
        wait_until(lambda: self.odometry.last.pose.pose.position.x > stopped_at + 0.05, "the drive to go on")
        self.assertIsNone(sent.ending)
        sent.cancel()
        self.assertEqual(sent.wait(10.0).status, GoalStatus.PREEMPTED)
        wait_until(lambda: not moves(self.velocity.last), "a zero as the last velocity")

    def test_4_without_anybody_who_publishes_the_clock_the_robot_is_stopped_and_the_client_told(self):
        sent = self.drive()
        type(self).running = False
        wait_until(lambda: rospy.get_time() >= self.time - 1e-6, "the last tick")
        self.clock.unregister()
        ending = sent.wait(20.0)
        type(self).clock = rospy.Publisher("/clock", Clock, queue_size=10)
        type(self).running = True
        self.assertIsNotNone(ending, "waited 20 s for the end of a goal without a clock, in vain")
        self.assertEqual(ending.status, GoalStatus.ABORTED)
        self.assertRegex(ending.result.message, r"/clock has stood at \d+\.\d+ s for \d+\.\d s")
        wait_until(lambda: not moves(self.velocity.last), "a zero as the last velocity")
        stood = self.odometry.last.header.stamp
        wait_until(lambda: self.odometry.last.header.stamp > stood, "the server to hear the new clock")
        sent = self.drive()
        sent.cancel()
        self.assertEqual(sent.wait(10.0).status, GoalStatus.PREEMPTED)


if __name__ == "__main__":
    rospy.init_node("navigation_clock_test")
    rostest.rosrun("mbf_relay", "navigation_clock", ClockTest)
