#!/usr/bin/env python3
"""The circle with a tenth of a core for all of navigation, which then drives by config/pi.yaml."""

import os
import sys
import unittest

import rospy
import rostest
from geometry_msgs.msg import Twist

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from benchmark.processes import node_pid  # noqa: E402
from ros_testing import wait_until  # noqa: E402
from running_stack import Witness, run_client, start_test_node  # noqa: E402
from slow_machine import SlowMachine  # noqa: E402
from tally import trial  # noqa: E402

NODES = ("/map_server", "/amcl", "/move_base_flex", "/move_base")
SHARE = 0.1
LATE = ("local_costmap was last updated", "local_costmap: lidar source 'scan' on topic 'scan' sent nothing")
"""What the server says where its process gets no turn for a second; the robot stands as long."""


class Cycles:
    """Counts velocities and the simulated time between those of one drive."""

    PAUSE = 1.0
    """Simulated seconds without a velocity that are no missed cycles but a pause between two goals."""

    def __init__(self) -> None:
        self.count, self.time, self._last = 0, 0.0, None
        self._subscriber = rospy.Subscriber("cmd_vel", Twist, self._take, queue_size=100, tcp_nodelay=True)

    def _take(self, _message: Twist) -> None:
        now = rospy.get_time()
        if self._last is not None and now - self._last < self.PAUSE:
            self.count, self.time = self.count + 1, self.time + now - self._last
        self._last = now

    @property
    def rate(self) -> float:
        """Velocities in a simulated second of driving."""
        return self.count / self.time


@unittest.skipUnless(os.environ.get("MBF_RELAY_LONG"), "only with --long: it drives at real time, on an idle machine")
class TestSlowMachine(unittest.TestCase):
    @trial("circles driven with a tenth of a core")
    def test_the_circle_is_driven_at_the_rate_asked_for(self):
        try:
            machine = SlowMachine(SHARE)
        except OSError as error:
            raise unittest.SkipTest(f"no control group can be made here: {error}") from error
        with machine:
            witness, cycles = Witness(), Cycles()
            machine.take(wait_until(processes, "all nodes", 60.0))
            run = run_client("mb_relay_client.py")
        self.assertEqual(run.status, 0, run.output)
        self.assertIn("Drove circle with result: True", run.output)
        self.assertEqual(witness.touched(), [])
        self.assertEqual([line for line in witness.warnings() if not any(words in line for words in LATE)], [])
        asked = rospy.get_param("move_base_flex/controller_frequency")
        self.assertGreater(cycles.rate, 0.9 * asked, f"velocities at {cycles.rate:.2f} Hz, asked for {asked:g} Hz")


def processes():
    """Return the processes of the nodes; None before all are there."""
    try:
        return [node_pid(node, rospy.get_name()) for node in NODES]
    except Exception:  # the master's, or a connection's
        return None


if __name__ == "__main__":
    start_test_node("slow_machine_test")
    rostest.rosrun("mbf_relay", "slow_machine", TestSlowMachine)
