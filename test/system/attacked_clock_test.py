#!/usr/bin/env python3
"""Strangers who publish times of their own on /clock: nothing is touched, no node ends, and the next goal works."""

import os
import random
import sys
import threading

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Twist
from rosgraph_msgs.msg import Clock

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from pulled import PulledCase, pid_of  # noqa: E402
from ros_testing import wait_until  # noqa: E402
from running_stack import start_test_node  # noqa: E402
from tally import how_many, trial  # noqa: E402

from mbf_relay.simulation.arena import CIRCLE  # noqa: E402

OURS = ("/move_base_flex", "/velocity_guard", "/move_base", "/amcl", "/map_server", "/simulator")
LAST = 2 ** 32 - 1
STRANGERS = {
    "nothing": lambda now, _chance: 0.0,
    "the last second there is": lambda now, _chance: LAST,
    "an hour ahead": lambda now, _chance: now + 3600.0,
    "half a second behind": lambda now, _chance: max(0.0, now - 0.5),
    "a second ahead": lambda now, _chance: now + 1.0,
    "any time": lambda now, chance: chance.choice((0.0, 1e-9, now, 2.0 * now, chance.uniform(0.0, LAST), LAST)),
}
"""What each tells, of the simulator's time and its chance."""
TIMES, PERIOD = 60, 0.03
"""How often a stranger tells its time, and wall seconds between two; two of them do at once."""


class Stranger(threading.Thread):
    """Tells another time than the simulator's, which it hears as everybody does."""

    def __init__(self, tell, seed):
        super().__init__(daemon=True)
        self._tell, self._chance, self._true = tell, random.Random(seed), 0.0
        self._hear = rospy.Subscriber("/clock", Clock, self._take, queue_size=1)
        self._publisher = rospy.Publisher("/clock", Clock, queue_size=10, tcp_nodelay=True)

    def _take(self, message):
        if message._connection_header["callerid"] == "/simulator":
            self._true = message.clock.to_sec()

    def run(self):
        pause = threading.Event()
        for _ in range(TIMES):
            self._publisher.publish(Clock(rospy.Time.from_sec(self._tell(self._true, self._chance))))
            pause.wait(PERIOD)
        self._hear.unregister()
        self._publisher.unregister()


class TestAttackedClock(PulledCase):
    def test_a_robot_whose_clock_strangers_tell_touches_nothing_and_reaches_its_next_goal(self):
        self.wait_until_all_is_back()
        pids = {node: pid_of(node) for node in OURS}
        for index in range(how_many(len(STRANGERS), 60)):
            what = list(STRANGERS)[index % len(STRANGERS)]
            with trial("strangers who publish on /clock while the robot drives") as made:
                place = CIRCLE[index % len(CIRCLE)]
                sent = self.drive(place)
                strangers = [Stranger(STRANGERS[what], 10 * index + number) for number in range(2)]
                for stranger in strangers:
                    stranger.start()
                for stranger in strangers:
                    stranger.join()
                ending = sent.wait(120.0)
                self.assertIsNotNone(ending, f"waited 120 s for the end of a goal after {what}")
                made.measure("goals reached all the same", float(ending.status == GoalStatus.SUCCEEDED), "")
                if ending.status != GoalStatus.SUCCEEDED:
                    rospy.loginfo("told %s: %s", what, ending.text)
                    wait_until(lambda: self.commands.last == Twist(), "a zero as the last velocity")
                self.assertEqual(self.witness.touched(), [], what)
                self.check_next_goal(place, f"strangers told {what}")
                self.assertEqual({node: pid_of(node) for node in OURS}, pids, f"nodes that ended when told {what}")


if __name__ == "__main__":
    start_test_node("attacked_clock_test")
    rostest.rosrun("mbf_relay", "attacked_clock", TestAttackedClock)
