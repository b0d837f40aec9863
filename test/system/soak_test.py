#!/usr/bin/env python3
"""A robot that is sent from place to place over a weekend: each goal is reached, and no node grows.

    scripts/test --long system/soak.test      2000 goals; MBF_RELAY_FACTOR=8 drives them at that factor of real time

A goal that a busy machine kept from being reached is counted and named, and the next one is sent; any other one fails
the test, at its end.
"""

import os
import statistics
import sys
import time

import psutil
import rospy
import rostest
from geometry_msgs.msg import Twist

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from pulled import NODES, PulledCase, goal_at, pid_of  # noqa: E402
from ros_testing import wait_until  # noqa: E402
from running_stack import OF_THE_MACHINE, start_test_node  # noqa: E402
from tally import how_many, trial  # noqa: E402

OURS = (*NODES[:5], "/simulator")
SIDE = 0.45
HALF = 0.5**0.5
SQUARE = (
    (-2.0 + SIDE, -0.5, HALF, HALF), (-2.0 + SIDE, -0.5 + SIDE, 1.0, 0.0), (-2.0, -0.5 + SIDE, -HALF, HALF),
    (-2.0, -0.5, 0.0, 1.0),
)
"""Corners in the open, x, y (m) and the heading to the next (z and w of its quaternion), the start last."""
SETTLED = 0.1
"""Share of the goals after which every list and cache has its size."""
LOST_FOR_GOOD = 3
"""Goals one after the other whose loss says that something is broken, whatever the machine does."""
FEW = 3
"""Threads and files by which a node may differ from one moment to the next."""


class Use(dict):
    """What each of our nodes holds: resident memory (bytes), threads, open files."""

    def __init__(self):
        processes = {node: psutil.Process(pid_of(node)) for node in OURS}
        super().__init__({
            node: (process.memory_info().rss, process.num_threads(), process.num_fds())
            for node, process in processes.items()
        })


class TestSoak(PulledCase):
    def drive_to(self, place):
        """Drive to a place; return the wall time (s) to the first velocity."""
        heard, sent_at = len(self.commands.messages), time.monotonic()
        sent = self.client.send(goal_at(place))
        wait_until(
            lambda: sent.ending or any(twist != Twist() for twist in self.commands.messages[heard:]), "a velocity",
            60.0, period=0.001,
        )
        latency = time.monotonic() - sent_at
        self.check_arrival(sent, f"a goal at {place}")
        return latency

    def starved_by(self):
        """Return why the machine may have kept a robot from its goal: what nodes said, or its load; empty where not."""
        said = [line for line in self.witness.complaints() if any(words in line for words in OF_THE_MACHINE)]
        load, cores = os.getloadavg()[0], os.cpu_count()
        return "; ".join(said[-2:] + [f"load {load:.1f} on {cores} cores"] * (load > cores))

    def forget(self):
        """Keep of each message only the newest."""
        for listener in (self.commands, self.truth, self.outcomes):
            del listener.messages[:-1]
        self.witness.forget_all()

    def drive_all(self, count):
        """Drive to so many places, one after the other; return the latencies, the goals lost, and what nodes held.

        Where a goal is lost the next one is sent, as somebody who needs a robot would; a contact ends it all.
        """
        latencies, lost, in_a_row, settled = [], [], 0, None
        for index in range(count):
            try:
                with trial("goals one after the other"):
                    latencies.append(self.drive_to(SQUARE[index % len(SQUARE)]))
                in_a_row = 0
            except AssertionError as error:
                self.assertEqual(self.witness.touched(), [], f"touched on the way to goal {index + 1}")
                lost.append((f"goal {index + 1}: {error}", self.starved_by()))
                rospy.logwarn("lost %s (the machine: %s)", *lost[-1])
                in_a_row += 1
                self.assertLess(in_a_row, LOST_FOR_GOOD, lost)
                self.wait_until_all_is_back()
            self.forget()
            if settled is None and index >= SETTLED * count:
                settled = Use()
        return latencies, lost, settled

    def test_a_robot_that_drives_for_days_reaches_each_goal_and_grows_by_nothing(self):
        self.wait_until_all_is_back()
        count = how_many(4, 2000)
        latencies, lost, settled = self.drive_all(count)
        with trial("what nodes hold after many goals") as made:
            made.measure("goals lost on a machine too slow", sum(bool(starved) for _, starved in lost), "")
            for node, (memory, threads, files) in Use().items():
                before = settled[node]
                made.measure(f"{node}, memory after a tenth of them grew by", 100.0 * (memory / before[0] - 1.0), "%")
                made.measure(f"{node}, memory after a tenth of them", before[0] / 2.0**20, "MiB")
                made.measure(f"{node}, memory at the end", memory / 2.0**20, "MiB")
                made.measure(f"{node}, threads at the end", threads, "")
                made.measure(f"{node}, open files at the end", files, "")
                self.assertLessEqual(abs(threads - before[1]), FEW, f"{node} has {threads} threads, had {before[1]}")
                self.assertLessEqual(abs(files - before[2]), FEW, f"{node} has {files} open files, had {before[2]}")
            part = max(1, count // 10)
            for name, some in (("first", latencies[:part]), ("last", latencies[-part:])):
                made.measure(f"first velocity after, {name} tenth", 1e3 * statistics.median(some), "ms")
            self.assertEqual([what for what, starved in lost if not starved], [], "no busy machine explains that")


if __name__ == "__main__":
    start_test_node("soak_test")
    rostest.rosrun("mbf_relay", "soak", TestSoak)
