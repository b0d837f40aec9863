#!/usr/bin/env python3
"""The tutorial's circle, driven with the tutorial's launch files and clients."""

import os
import sys
import unittest

import rospy
import rostest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from running_stack import Witness, run_client, start_test_node  # noqa: E402

from mbf_relay.ros.tools.clients import CIRCLE  # noqa: E402

NEAR = 0.15
"""Metres: the goal tolerance of the parameter file, 0.05, and what localization may be off."""


class TestCircle(unittest.TestCase):
    def test_the_client_drives_the_circle(self):
        witness = Witness()
        for client in rospy.get_param("~clients", ["mb_relay_client.py"]):
            run = run_client(client)
            self.assertIn("Drove circle with result: True", run.output)
            self.assertEqual(run.status, 0, run.output)
            for x, y, _, _ in CIRCLE:
                self.assertLess(witness.way_to(x, y), NEAR, f"goal ({x}, {y}) of {client}")
            self.assertEqual(witness.touched(), [])
            self.assertEqual(witness.warnings(), [])
            witness.forget()


if __name__ == "__main__":
    start_test_node("circle_test")
    rostest.rosrun("mbf_relay", "circle", TestCircle)
