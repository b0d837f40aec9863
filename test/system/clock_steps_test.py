#!/usr/bin/env python3
"""A clock that is set while the robot drives: it goes on, or its client hears of the clock; the next goal works."""

import os
import sys

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Twist
from std_msgs.msg import Float64

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from pulled import PulledCase, goal_at  # noqa: E402
from ros_testing import connected_publisher, wait_until  # noqa: E402
from running_stack import start_test_node  # noqa: E402
from tally import trial  # noqa: E402

from mbf_relay.simulation.arena import CIRCLE  # noqa: E402

STEPS = (5.0, -5.0, 0.4, -0.4, 3600.0, -100.0)
"""Seconds."""
CAUSES = r"transform|time|clock|scan|odometry"


class TestClockSteps(PulledCase):
    def set_clock(self, seconds):
        """Set the clock and wait until it is seen here."""
        before = rospy.get_time()
        self.steps.publish(seconds)
        wait_until(
            lambda: abs(rospy.get_time() - before - seconds) < 0.5 * abs(seconds) or seconds > 0.0 and
            rospy.get_time() > before + seconds, f"the clock to be set by {seconds} s")

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
