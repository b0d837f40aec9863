#!/usr/bin/env python3
"""Nodes that are killed or frozen while the robot drives: it stands, its client is told why, and the next goal works.
"""

import math
import os
import random
import resource
import signal
import sys

import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Twist

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from pulled import NODES, PulledCase, goal_at, pid_of  # noqa: E402
from ros_testing import wait_until  # noqa: E402
from running_stack import start_test_node  # noqa: E402
from tally import how_many, trial  # noqa: E402

from mbf_relay.simulation.arena import CIRCLE  # noqa: E402

OURS = (*NODES[:5], "/simulator")

WORDS = {signal.SIGKILL: "killed", signal.SIGSTOP: "frozen"}
LOST = r"transform from 'map' to 'odom' is \d+\.\d\d s old"
"""What ends a drive without localization."""
AT_ONCE, WITHOUT_POSE = 0.25, 0.35
"""Metres the robot may come without what is on the way to its wheels, and without a pose, on a slow machine too."""
NEEDED = {"/move_base_flex": AT_ONCE, "/velocity_guard": AT_ONCE, "/amcl": WITHOUT_POSE, "/move_base": 0.7}
"""What a drive cannot go on without, and the metres the robot may come; the server waits a second for a relay."""
NEXT_PLACE = 1.0
"""Metres that a place is away which is not the one the robot stands at."""
PAIRS = (("/move_base_flex", "/velocity_guard"), ("/amcl", "/map_server"), ("/move_base", "/move_base_flex"))


class TestPulledNodes(PulledCase):
    """Run in the order of their names."""

    def far_place(self):
        """Return the place of the circle farthest from the robot, wherever the trials before have left it."""
        return max(CIRCLE, key=self.way_to)

    def near_place(self):
        """Return the nearest place of the circle that is to be driven to, where any will do."""
        return min((place for place in CIRCLE if self.way_to(place) > NEXT_PLACE), key=self.way_to)

    def way_to(self, place):
        here = self.witness.pose
        return math.hypot(place[0] - here.x, place[1] - here.y)

    def check_relay_stopped_it(self):
        def is_seen():
            return any(m == Twist() and m._connection_header["callerid"] == "/move_base"
                       for m in self.commands.messages[self.heard:])

        wait_until(is_seen, "the relay's own zero, which comes another way than the goal's end")

    def test_1_a_frozen_server(self):
        sent = self.drive(CIRCLE[0])
        server = self.signal("/move_base_flex", signal.SIGSTOP)
        try:
            self.check_told_to_stand("a frozen server", AT_ONCE)
            self.check_stop(sent, r"/move_base_flex has been silent for \d+\.\d s")
            self.check_relay_stopped_it()
        finally:
            os.kill(server, signal.SIGCONT)

    def test_2_a_killed_server(self):
        sent = self.drive(CIRCLE[0])
        self.signal("/move_base_flex", signal.SIGKILL)
        self.check_told_to_stand("a killed server", AT_ONCE)
        self.check_stop(sent, "/move_base_flex/move_base died")
        self.check_relay_stopped_it()

    def test_3_a_map_once_given_needs_no_map_server(self):
        sent = self.drive(CIRCLE[0])
        self.signal("/map_server", signal.SIGKILL)
        self.check_arrival(sent, "map_server was killed")

    def test_5_a_killed_localization(self):
        sent = self.drive(self.far_place())
        self.signal("/amcl", signal.SIGKILL)
        self.check_told_to_stand("a killed localization", WITHOUT_POSE)
        ending = sent.wait(120.0)
        self.assertIsNotNone(ending, "waited 120 s for the goal's end, in vain")
        if ending.status == GoalStatus.SUCCEEDED:  # it was back within the controller's patience
            self.check_arrival(sent, "localization was killed and came back")
        else:
            self.check_stop(sent, LOST)
        self.check_next_goal(self.near_place(), "localization was killed")

    def test_6_a_frozen_localization(self):
        sent = self.drive(self.far_place())
        amcl = self.signal("/amcl", signal.SIGSTOP)
        try:
            self.check_told_to_stand("a frozen localization", WITHOUT_POSE)
            self.check_stop(sent, LOST)
        finally:
            os.kill(amcl, signal.SIGCONT)
        self.check_next_goal(self.near_place(), "localization was frozen")

    def test_4_any_node_killed_or_frozen_at_any_moment(self):
        """What is pulled is back without a hand: the robot does not run on without it, and the next goal is reached."""
        chance = random.Random(7)
        for index in range(how_many(4, 100)):
            node = NODES[index % len(NODES)]
            number = chance.choice((signal.SIGKILL, signal.SIGSTOP))
            place = CIRCLE[index % len(CIRCLE)]
            drives, moment = chance.random() < 0.7, chance.uniform(0.0, 0.1)
            with trial("nodes killed and frozen at any moment") as made:
                self.pull(node, number, place, drives, moment, made)
                self.check_next_goal(place, f"{node} got signal {int(number)} in trial {index}")

    def test_8_two_nodes_killed_at_once(self):
        """The robot does not run on without both, and the next goal is reached."""
        for index in range(how_many(len(PAIRS), 12)):
            pair, place = PAIRS[index % len(PAIRS)], self.near_place()
            with trial("two nodes killed at once") as made:
                self.drive(place)
                self.signal(pair[0], signal.SIGKILL)
                os.kill(pid_of(pair[1]), signal.SIGKILL)
                what = " and ".join(pair) + " killed"
                self.check_told_to_stand(what, max(NEEDED.get(node, 0.0) for node in pair), made)
                self.client.cancel_all()
                self.check_next_goal(place, what)

    def test_9_a_goal_taken_while_localization_and_map_are_killed_ends_once(self):
        self.wait_until_all_is_back()
        for node in ("/amcl", "/map_server"):
            os.kill(pid_of(node), signal.SIGKILL)
        sent = self.client.send(goal_at(self.near_place()))
        self.assertIsNotNone(sent.wait(120.0), "waited 120 s for the goal's end, in vain")
        self.assertEqual(self.witness.touched(), [])
        self.check_next_goal(self.near_place(), "localization and map were killed")

    def test_7_a_disk_that_gets_full_on_the_way_stops_no_drive(self):
        self.wait_until_all_is_back()
        pids = {node: pid_of(node) for node in OURS}
        sent = self.drive(self.near_place())
        limits = {pid: resource.prlimit(pid, resource.RLIMIT_FSIZE) for pid in pids.values()}
        try:
            for pid, (_soft, hard) in limits.items():
                resource.prlimit(pid, resource.RLIMIT_FSIZE, (0, hard))
            self.check_arrival(sent, "the disk was full")
            self.check_next_goal(self.near_place(), "the disk was full for long")
            self.assertEqual({node: pid_of(node) for node in OURS}, pids)
        finally:
            for pid, limit in limits.items():
                resource.prlimit(pid, resource.RLIMIT_FSIZE, limit)

    def pull(self, node, number, place, drives, moment, made):
        """Kill or freeze a node, see what the robot does, and let a frozen one go on.

        Args:
            node: Its name.
            number: The signal.
            place: Where to drive meanwhile.
            drives: Whether the robot drives at all.
            moment: Metres to drive before.
            made: The trial that this is part of.
        """
        if drives:
            self.wait_for_way(moment, self.drive(place))
        pid = self.signal(node, number)
        try:
            if drives and node in NEEDED:
                self.check_told_to_stand(f"{node} {WORDS[number]}", NEEDED[node], made)
        finally:
            if number == signal.SIGSTOP:
                os.kill(pid, signal.SIGCONT)
        self.client.cancel_all()


if __name__ == "__main__":
    start_test_node("pulled_nodes_test")
    rostest.rosrun("mbf_relay", "pulled_nodes", TestPulledNodes)
