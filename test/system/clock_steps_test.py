#!/usr/bin/env python3
"""A clock that is set while the robot drives: it goes on, or its client hears of the clock; the next goal works."""

import os
import sys

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Twist
from mbf_msgs.msg import RecoveryAction, RecoveryGoal
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Bool, Float64

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from pulled import SLOW, PulledCase, goal_at  # noqa: E402
from ros_testing import Listener, connected_publisher, wait_until  # noqa: E402
from running_stack import start_test_node  # noqa: E402
from tally import trial  # noqa: E402

from mbf_relay.ros.common.actions.action_client import ActionClient  # noqa: E402
from mbf_relay.simulation.arena import CIRCLE  # noqa: E402

RECOVERY = "move_base_flex/recovery"
STEPS = (5.0, -5.0, 0.4, -0.4, 3600.0, -100.0)
"""Seconds."""
CAUSES = r"transform|time|clock|scan|odometry"


class TestClockSteps(PulledCase):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.true_clock = Listener("/true/clock", Clock, connected=True)
        cls.true_clock.wait_for(bool, "the simulator's time")

    def set_clock(self, seconds):
        """Set the clock and wait until it is seen here."""
        before = self.clock_error()
        self.steps.publish(seconds)
        wait_until(
            lambda: abs(self.clock_error() - before - seconds) < 0.25 * abs(seconds),
            f"the clock to be set by {seconds} s")

    def clock_error(self):
        """Return how far the clock is ahead of the simulator's own, in seconds."""
        return rospy.get_time() - self.true_clock.last.clock.to_sec()

    def turn_round(self):
        """Begin a recovery that turns the robot; return its goal once it turns.

        A server that has no scan of a clock's new time yet turns nothing.
        """
        self.wait_until_all_is_back()
        sent = []

        def turns():
            if sent and sent[-1].ending is not None:
                self.assertIn("does not move blindly", sent[-1].ending.text)
            if not sent or sent[-1].ending is not None:
                sent.append(self.recovery.send(RecoveryGoal(behavior="rotate_recovery")))
            return abs(self.truth.last.twist.twist.angular.z) > 0.2 and sent[-1].ending is None

        wait_until(turns, "the robot to turn")
        self.heard = len(self.commands.messages)
        return sent[-1]

    def check_recovery_ends(self, sent, what):
        self.assertIsNotNone(sent.wait(60.0), f"waited 60 s for the end of a recovery, {what}")
        wait_until(lambda: self.commands.last == Twist() and self.speed() < SLOW, f"the robot to stand, {what}")

    def test_a_robot_whose_clock_is_set_while_it_recovers_turns_on_or_stands(self):
        self.steps, self.recovery = connected_publisher("clock_step", Float64), ActionClient(RECOVERY, RecoveryAction)
        self.assertTrue(self.recovery.wait_for_server(60.0))
        for seconds in STEPS:
            with trial("clocks set while the robot recovers"):
                sent = self.turn_round()
                self.set_clock(seconds)
                self.check_recovery_ends(sent, f"the clock set by {seconds} s")
        self.check_arrival(self.client.send(goal_at(CIRCLE[0])), "the clock was set in recoveries")

    def test_a_robot_whose_clock_stands_while_it_recovers_stands_too_and_turns_on_with_it(self):
        self.pause, self.recovery = connected_publisher("clock_pause", Bool), ActionClient(RECOVERY, RecoveryAction)
        self.assertTrue(self.recovery.wait_for_server(60.0))
        with trial("clocks set while the robot recovers"):
            sent = self.turn_round()
            self.pause.publish(True)
            wait_until(lambda: self.is_told_to_stand() and self.speed() < SLOW, "the robot to stand with its clock")
            self.pause.publish(False)
            self.check_recovery_ends(sent, "the clock paused")
        self.check_arrival(self.client.send(goal_at(CIRCLE[0])), "the clock was paused in a recovery")

    def test_a_robot_whose_clock_is_set_goes_on_or_stands_and_its_client_hears_why(self):
        self.wait_until_all_is_back()
        self.steps = connected_publisher("clock_step", Float64)
        for index, seconds in enumerate(STEPS):
            with trial("clocks set while the robot drives") as made:
                place = CIRCLE[index % len(CIRCLE)]
                sent = self.drive(place)
                self.heard = len(self.commands.messages)
                self.set_clock(seconds)
                ending = sent.wait(120.0)
                self.assertIsNotNone(ending, f"waited 120 s for the end of a goal when time was set by {seconds} s")
                made.measure(f"goals reached, of those with the clock set by {seconds:g} s",
                             float(ending.status == GoalStatus.SUCCEEDED), "")
                if ending.status != GoalStatus.SUCCEEDED:
                    outcome = self.outcomes.wait_for(lambda m, s=sent: m.status.goal_id.id == s.goal_id, "the outcome")
                    rospy.loginfo("clock set by %s s: %s", seconds, outcome.result.message)
                    self.assertRegex(outcome.result.message, CAUSES)
                    wait_until(lambda: self.commands.last == Twist(), "a zero as the last velocity")
                self.check_arrival(self.client.send(goal_at(place)), f"the clock was set by {seconds} s")


if __name__ == "__main__":
    start_test_node("clock_steps_test")
    rostest.rosrun("mbf_relay", "clock_steps", TestClockSteps)
