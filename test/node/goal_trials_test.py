#!/usr/bin/env python3
"""A few of each trial of goals, see goal_trials; --long makes as many as the proof asks for."""

import itertools
import os
import random
import signal
import sys
import threading
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from benchmark.processes import node_pid, resident_bytes
from node.goal_trials import BROKEN, FACES, GoalTrials
from ros_testing import wait_until
from slow_machine import BusyMachine, waits_for_a_core
from tally import LONG, how_many, trial

DELAYS = (0.0, 0.005, 0.02, 0.06, 0.15, 0.5)
"""Seconds from goal to cancel; whatever is tried beyond these is drawn from between the first and the last."""
CANCELLED = (GoalStatus.PREEMPTED, GoalStatus.RECALLED)
HOWS = (signal.SIGKILL, signal.SIGSTOP)
LOAD = 10
"""Processes that compute beside it."""
SOON = 1.0
"""Wall time (s) within which a robot that nobody has a goal for must stand, beside what processes wait for a core."""
SILENCE = 0.7 if LONG else 3.0
"""Wall time (s) of silence that is a hang: for figures the relay's own, else more than a busy machine has one wait."""


class Waits:
    """How long the processes of a trial could run and had no core, which no code can help.

    This process hears a zero that much later than it came, too.
    """

    def __init__(self, trials):
        self._processes = {"server": trials.server.pid, "relay": trials.relay.pid, "client": os.getpid()}
        self._before = {who: waits_for_a_core(pid) for who, pid in self._processes.items()}

    def of(self, who):
        """Return for how long (s) that thread of a process waited that waited longest since; 0.0 of one that ended."""
        before, now = self._before[who], waits_for_a_core(self._processes[who])
        return max((wait - before.get(thread, 0.0) for thread, wait in now.items()), default=0.0)

    def of_all(self):
        """Return for how long (s) they waited one after the other."""
        return sum(map(self.of, self._processes))


class GoalTrialsTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("goal_trials")
        cls.trials = GoalTrials(SILENCE)

    @classmethod
    def tearDownClass(cls):
        cls.trials.close()

    def setUp(self):
        self.trials.start()  # what a test that failed has left ended

    def check(self, made, outcome, what, allowed, waits):
        """Expect one result of those allowed, nothing after it, and a robot that stands; note how soon."""
        made.measure("last velocity after", 1e3 * outcome.stopped_after, "ms")
        if outcome.zero_after is not None:
            made.measure("zero after", 1e3 * outcome.zero_after, "ms")
        self.assertEqual(len(outcome.states), 1, f"{what}: one result, not {outcome}")
        self.assertIn(outcome.states[0], allowed, f"{what}: {outcome}")
        self.assertFalse(outcome.went_on, f"{what}: the status went on after the result")
        self.assertLess(outcome.stopped_after, SOON + waits.of_all(), f"{what}: {outcome}")

    def cancel(self, face, delay, what):
        """Cancel one goal; noted is also how long a thread of the server and of this process had no core meanwhile."""
        may_succeed = (GoalStatus.SUCCEEDED,) if face in ("get_path", "recovery") else ()
        with trial(what) as made:
            waits = Waits(self.trials)
            outcome = self.trials.cancel(face, delay)
            for who in ("server", "client"):
                made.measure(f"a thread of the {who} waited for a core", 1e3 * waits.of(who), "ms")
            self.check(made, outcome, f"{face} cancelled after {1e3 * delay:.0f} ms", CANCELLED + may_succeed, waits)

    def test_1_a_robot_called_back_at_any_moment_stands(self):
        moments, chance = list(itertools.product(FACES, DELAYS)), random.Random(1)
        drawn = ((face, chance.uniform(DELAYS[0], DELAYS[-1])) for face in itertools.cycle(FACES))
        moments += itertools.islice(drawn, how_many(len(moments), 5000) - len(moments))
        for face, delay in moments:
            self.cancel(face, delay, "goals cancelled at 0 to 500 ms")

    def test_6_a_robot_called_back_on_a_machine_with_ten_other_things_to_do_stands(self):
        chance = random.Random(2)
        with BusyMachine(LOAD):
            for face in itertools.islice(itertools.cycle(FACES), how_many(len(FACES), 1000)):
                self.cancel(face, chance.uniform(DELAYS[0], DELAYS[-1]), f"goals cancelled under a load of {LOAD}")

    def test_2_a_robot_whose_next_goal_is_nonsense_can_be_called_back(self):
        for kind in itertools.islice(itertools.cycle(BROKEN), how_many(len(BROKEN), 200)):
            with trial("drives replaced by a broken goal") as made:
                waits = Waits(self.trials)
                outcome = self.trials.replace(kind)
                self.check(made, outcome, f"replaced by a goal whose {kind}", (GoalStatus.ABORTED,), waits)

    def test_3_a_robot_whose_relay_is_gone_stands_and_the_next_goal_works(self):
        for how in itertools.islice(itertools.cycle(HOWS), how_many(2, 24)):
            with trial("relay and server killed and frozen in a drive") as made:
                waits = Waits(self.trials)
                outcome = self.trials.orphan(how)
                self.assertLess(outcome.stopped_after, 1.5 * SOON + waits.of_all(), f"{how.name}: {outcome}")
                if how == signal.SIGSTOP:
                    self.check(made, outcome, how.name, (GoalStatus.PREEMPTED,), waits)
                    self.assertIn("has not renewed it", outcome.text)
                else:
                    made.measure("last velocity after", 1e3 * outcome.stopped_after, "ms")
                self.trials.start()  # not before: what it takes to start is no wait of a robot

    def test_4_a_robot_whose_server_is_gone_is_stopped_and_the_next_goal_works(self):
        words = {signal.SIGKILL: "died", signal.SIGSTOP: "hangs"}
        for how in itertools.islice(itertools.cycle(HOWS), how_many(2, 24)):
            with trial("relay and server killed and frozen in a drive") as made:
                waits = Waits(self.trials)
                outcome = self.trials.lose_server(how)
                made.measure("last velocity after", 1e3 * outcome.stopped_after, "ms")
                self.assertLess(outcome.stopped_after, SILENCE + 0.8 * SOON + waits.of_all(), f"{how.name}: {outcome}")
                self.assertEqual(outcome.states, [GoalStatus.ABORTED])
                self.assertIn(words[how], outcome.text)
                self.trials.start()

    def test_5_every_goal_of_twenty_stock_clients_has_one_end(self):
        threads = threading.active_count()
        relay = node_pid("/move_base", rospy.get_name())
        before = resident_bytes(relay)
        with trial("twenty stock clients at once") as made:
            counts = self.trials.crowd(20, *((20.0, 120.0) if LONG else (5.0, 4.0)))
            made.measure("goals", sum(counts.values()), "")
            made.measure("memory the relay grew by", (resident_bytes(relay) - before) / 2.0**20, "MiB")
            self.assertLessEqual(set(counts), {"PREEMPTED", "RECALLED", "SUCCEEDED"}, str(counts))
            self.assertGreater(sum(counts.values()), 20)
            wait_until(lambda: threading.active_count() <= threads + 5, "the clients' threads to end")


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "goal_trials", GoalTrialsTest)
