#!/usr/bin/env python3
"""A few of each trial of goals, see goal_trials; MBF_RELAY_LONG makes as many as the proof asks for."""

import itertools
import os
import signal
import sys
import threading
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from node.goal_trials import BROKEN, FACES, GoalTrials

LONG = os.environ.get("MBF_RELAY_LONG") == "1"
DELAYS = [0.001 * 500 * step / 49 for step in range(50)] if LONG else (0.0, 0.005, 0.02, 0.06, 0.15, 0.5)
"""Seconds from goal to cancel."""
CANCELLED = (GoalStatus.PREEMPTED, GoalStatus.RECALLED)
SOON = 1.0
"""Wall time (s) within which a robot that nobody has a goal for must stand, on a machine with other things to do."""


class GoalTrialsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("goal_trials")
        cls.trials = GoalTrials()

    @classmethod
    def tearDownClass(cls):
        cls.trials.close()

    def check(self, trial, what, allowed):
        self.assertEqual(len(trial.states), 1, f"{what}: one result, not {trial}")
        self.assertIn(trial.states[0], allowed, f"{what}: {trial}")
        self.assertFalse(trial.went_on, f"{what}: the status went on after the result")
        self.assertLess(trial.stopped_after, SOON, f"{what}: {trial}")

    def test_1_a_robot_called_back_at_any_moment_stands(self):
        for face, delay, _ in itertools.product(FACES, DELAYS, range(20 if LONG else 1)):
            may_succeed = (GoalStatus.SUCCEEDED,) if face in ("get_path", "recovery") else ()
            self.check(
                self.trials.cancel(face, delay), f"{face} cancelled after {1e3 * delay:.0f} ms", CANCELLED + may_succeed
            )

    def test_2_a_robot_whose_next_goal_is_nonsense_can_be_called_back(self):
        for kind in list(BROKEN) * (19 if LONG else 1):
            self.check(self.trials.replace(kind), f"replaced by a goal whose {kind}", (GoalStatus.ABORTED,))

    def test_3_a_robot_whose_relay_is_gone_stands_and_the_next_goal_works(self):
        for how in (signal.SIGKILL, signal.SIGSTOP) * (12 if LONG else 1):
            trial = self.trials.orphan(how)
            self.assertLess(trial.stopped_after, 1.5 * SOON, f"{how.name}: {trial}")
            if how == signal.SIGSTOP:
                self.check(trial, how.name, (GoalStatus.PREEMPTED,))
                self.assertIn("has not renewed it", trial.text)

    def test_4_a_robot_whose_server_is_gone_is_stopped_and_the_next_goal_works(self):
        for how, words in ((signal.SIGKILL, "died"), (signal.SIGSTOP, "hangs")) * (12 if LONG else 1):
            trial = self.trials.lose_server(how)
            self.assertLess(trial.stopped_after, 1.5 * SOON, f"{how.name}: {trial}")
            self.assertEqual(trial.states, [GoalStatus.ABORTED])
            self.assertIn(words, trial.text)

    def test_5_every_goal_of_twenty_stock_clients_has_one_end(self):
        threads = threading.active_count()
        counts = self.trials.crowd(20, *((20.0, 120.0) if LONG else (5.0, 4.0)))
        self.assertLessEqual(set(counts), {"PREEMPTED", "RECALLED", "SUCCEEDED"}, str(counts))
        self.assertGreater(sum(counts.values()), 20)
        self.assertLessEqual(threading.active_count(), threads + 5)


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "goal_trials", GoalTrialsTest)
