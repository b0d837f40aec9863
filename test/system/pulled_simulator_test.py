#!/usr/bin/env python3
"""The robot's base is pulled while it drives, and its clock with it: what is left tells the wheels to stand."""

import os
import random
import signal
import sys

import rostest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from pulled import PulledCase, pid_of  # noqa: E402
from ros_testing import LOOK_PERIOD, wait_until  # noqa: E402
from running_stack import start_test_node  # noqa: E402
from tally import how_many, trial  # noqa: E402

from mbf_relay.simulation.arena import CIRCLE  # noqa: E402

LOST = r"/clock has stood at \d+\.\d\d s for \d+\.\d s and nobody publishes it any more"
"""What ends a drive without a base."""


class TestPulledSimulator(PulledCase):
    """Run in the order of their names.

    How far the robot comes meanwhile says nothing: it is what was pulled, and this process may hear late where it was.
    """

    def test_1_a_frozen_base_hears_a_zero_first_of_all_and_the_drive_goes_on(self):
        sent = self.drive(CIRCLE[0])
        self.freeze()
        self.check_arrival(sent, "the simulator was frozen")

    def freeze(self, made=None):
        """Freeze the simulator until the wheels were told to stand."""
        simulator = self.signal("/simulator", signal.SIGSTOP)
        try:
            self.wait_until_told_to_stand("a frozen simulator", made)
        finally:
            os.kill(simulator, signal.SIGCONT)

    def test_2_a_killed_base_ends_the_drive_and_the_next_goal_works(self):
        self.kill(self.drive(CIRCLE[1]), CIRCLE[0])

    def kill(self, sent, place, made=None):
        """Kill the simulator in a drive; expect the goal to end for it, and the next one to be reached."""
        killed = self.signal("/simulator", signal.SIGKILL)
        self.wait_until_told_to_stand("a killed simulator", made)
        self.check_stop(sent, LOST)
        wait_until(
            lambda: pid_of("/simulator") not in (None, killed), "the simulator to be back", period=LOOK_PERIOD)
        self.check_next_goal(place, "the simulator was killed")

    def test_3_again_and_again(self):
        chance = random.Random(11)
        for index in range(how_many(1, 30)):
            place = CIRCLE[(index + 1) % len(CIRCLE)]  # the test before has left it at the first
            self.wait_until_all_is_back()
            moment, killed = chance.uniform(0.0, 0.5), chance.random() < 0.5
            with trial("nodes killed and frozen at any moment") as made:
                sent = self.drive(place)
                self.wait_for_way(moment, sent)
                if killed:
                    self.kill(sent, place, made)
                else:
                    self.freeze(made)
                    self.check_arrival(sent, f"the simulator was frozen in trial {index}")


if __name__ == "__main__":
    start_test_node("pulled_simulator_test")
    rostest.rosrun("mbf_relay", "pulled_simulator", TestPulledSimulator)
