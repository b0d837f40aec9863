#!/usr/bin/env python3
"""What any node on the network may ask of the services, parameters at run time included: each asking is answered.

No node ends, nothing is driven, no answer has what is no number, and what is refused is refused in one line.
"""

import math
import os
import sys
import threading
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))

import genpy
import rosgraph
import rospy
import rosservice
import rostest
from dynamic_reconfigure.srv import Reconfigure, ReconfigureRequest
from geometry_msgs.msg import Twist
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from random_messages import NUMBERS, WORDS, message, values
from ros_testing import LOOK_PERIOD, Listener, wait_until
from rosgraph_msgs.msg import Log

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from pulled import NODES, pid_of  # noqa: E402
from running_stack import start_test_node  # noqa: E402
from tally import LONG, how_many, trial  # noqa: E402

OURS = (*NODES[:5], "/simulator")
ROSPYS = ("get_loggers", "set_logger_level", "tf2_frames")
RECORDS = "/simulator/take_pictures"  # takes long and writes files
ASKED = 5000
"""Requests that are made in all under --long."""
WIDE = 0.8
"""Share of services that can be asked for so many different things; of one that takes a few switches there are few."""
KINDS = {"bools": st.booleans(), "ints": values("int32"), "strs": WORDS, "doubles": NUMBERS}


def services():
    """Return the names of our nodes' services, by their classes."""
    offered = rosgraph.Master(rospy.get_name()).getSystemState()[2]
    names = sorted(name for name, nodes in offered if set(nodes) & set(OURS))
    return [
        (name, rosservice.get_service_class_by_name(name)) for name in names
        if name != RECORDS and name.rsplit("/", 1)[-1] not in ROSPYS
    ]


def not_finite(answer):
    """Return the names of fields of a message that are no finite numbers."""
    found = []
    for name in getattr(answer, "__slots__", ()):
        value = getattr(answer, name)
        for item in value if isinstance(value, (list, tuple)) else [value]:
            if isinstance(item, float) and not math.isfinite(item):
                found.append(name)
            found += [f"{name}.{inner}" for inner in not_finite(item)]
    return found


@st.composite
def changes_of(draw, config):
    """Return a request to change some of a node's parameters to anything."""
    request = ReconfigureRequest()
    for group, strategy in KINDS.items():
        for parameter in getattr(config, group):
            if draw(st.booleans()):
                getattr(request.config, group).append(type(parameter)(parameter.name, draw(strategy)))
    return request


class TestFuzzedServices(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.log = Listener("/rosout", Log, connected=True)
        cls.velocities = Listener("cmd_vel", Twist, connected=True)
        for node in OURS:
            wait_until(lambda node=node: pid_of(node), f"{node}", 60.0, LOOK_PERIOD)
        wait_until(lambda: len(services()) >= 25, "all services", 60.0, LOOK_PERIOD)
        cls.pids = {node: pid_of(node) for node in OURS}

    @trial("services asked for anything")
    def ask(self, name, kind, request):
        """Call a service; returns its answer, None where it refused, or where the request is none that can be sent."""
        answers = []

        def call():
            try:
                answers.append(rospy.ServiceProxy(name, kind)(request))
            except (rospy.ServiceException, genpy.SerializationError, OverflowError):
                answers.append(None)

        threading.Thread(target=call, daemon=True).start()
        wait_until(lambda: answers, f"an answer of {name} to {request}", 60.0, period=0.001)
        if answers[0] is not None:
            self.assertEqual(not_finite(answers[0]), [], f"{name} answered {request} with {answers[0]}")
        return answers[0]

    def check_all_is_well(self):
        self.assertEqual({node: pid_of(node) for node in OURS}, self.pids)
        self.assertEqual([twist for twist in self.velocities.messages if twist != Twist()], [])
        self.assertEqual([entry.msg for entry in self.log.messages if "Traceback" in entry.msg], [])

    def ask_blindly(self, name, kind, requests):
        """Ask for what chance makes, so often that all services together come to ASKED."""
        askable = [service for service, its in services() if its is Reconfigure or its._request_class.__slots__]
        chance = settings(
            max_examples=how_many(8, math.ceil(ASKED / (WIDE * len(askable)))), deadline=None, database=None,
            derandomize=not LONG, suppress_health_check=list(HealthCheck))

        @chance
        @given(requests)
        def ask(request):
            self.ask(name, kind, request)

        ask()

    def test_1_services(self):
        for name, kind in services():
            if kind is not Reconfigure:
                self.ask_blindly(name, kind, message(kind._request_class))
        rospy.ServiceProxy("/simulator/unpause", rosservice.get_service_class_by_name("/simulator/unpause"))()
        self.check_all_is_well()

    def test_2_reconfiguring(self):
        for name, kind in services():
            if kind is Reconfigure:
                before = self.ask(name, kind, ReconfigureRequest()).config
                self.ask_blindly(name, kind, changes_of(before))
                self.ask(name, kind, ReconfigureRequest(before))
        self.check_all_is_well()


if __name__ == "__main__":
    start_test_node("fuzzed_services_test")
    rostest.rosrun("mbf_relay", "fuzzed_services", TestFuzzedServices)
