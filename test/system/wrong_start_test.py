#!/usr/bin/env python3
"""Nodes started with something wrong end at once, with one line that names it, its value and what is allowed."""

import itertools
import re
import subprocess
import sys
import unittest

import rospy
import rostest
from programs import program

PATIENCE = 60.0
NUMBERS = itertools.count(1)
NO_PLANNER = "_planners:=[{name: Pathfinder, type: atlantis/Pathfinder}]"
NO_CONTROLLER = "_controllers:=[{name: Pilot, type: atlantis.pilot.Pilot}]"

WRONG = [
    # executable, arguments, words of the one line
    ("map_server", ["/nowhere/map.yaml"], ["/nowhere/map.yaml"]),
    ("map_server", [], ["usage"]),
    ("simulator", ["_world:=atlantis"], ["world", "atlantis", "arena", "empty"]),
    ("simulator", ["_world:=/nowhere/map.yaml"], ["/nowhere/map.yaml"]),
    ("simulator", ["_max_speed:=fast"], ["max_speed", "fast"]),
    ("simulator", ["_scan_rate:=7.0"], ["scan_rate", "7", "divide", "120"]),
    ("amcl", ["_min_particles:=many"], ["min_particles", "many"]),
    ("move_base_flex", ["_controller_frequency:=often"], ["controller_frequency", "often"]),
    ("move_base_flex", ["_global_costmap:={resolution: -1.0}"], ["resolution", "-1"]),
    ("mb_relay_client.py", ["--timeout", "1"], ["move_base"]),
]

TAKEN = [
    # what a human would start with all the same: executable, arguments, words of the one line that says so
    ("simulator", ["_max_speed:=-1.0"], ["max_speed", "-1"]),
    ("amcl", ["_min_particles:=-5"], ["min_particles", "-5"]),
    ("amcl", ["_laser_model_type:=sonar"], ["laser_model_type", "sonar", "likelihood_field", "beam"]),
    ("move_base_flex", [NO_PLANNER], ["Pathfinder", "atlantis/Pathfinder", "navfn/NavfnROS"]),
    ("move_base_flex", [NO_CONTROLLER], ["Pilot", "atlantis.pilot.Pilot", "dwa_local_planner/DWAPlannerROS"]),
    ("move_base_relay", ["_server_timeout:=-1.0"], ["server_timeout", "-1"]),
]


class TestWrongStart(unittest.TestCase):
    """One test for each entry of WRONG and of TAKEN, added below."""


def add_test(executable, arguments, words):
    def test(self):
        status, output = run(executable, arguments)
        self.assertNotIn("Traceback", output)
        self.assertNotEqual(status, 0, output)
        fatal = [line for line in output.splitlines() if "FATAL" in line or line.startswith(f"{executable}: ")]
        self.assertEqual(len(fatal), 1, output)
        for word in words:
            self.assertIn(word, fatal[0])

    name = re.sub(r"[^a-z0-9]+", "_", " ".join([executable] + arguments).lower()).strip("_")
    setattr(TestWrongStart, f"test_{name}", test)


def add_test_of_taken(executable, arguments, words):
    def test(self):
        process = start(executable, arguments)
        said = []
        try:
            for line in process.stdout:
                said.append(line)
                if all(word in line for word in words):
                    break
            else:
                self.fail(f"{executable} {arguments} ended without a line that has {words}:\n{''.join(said)}")
            self.assertIsNone(process.poll(), "it goes on")
        finally:
            process.terminate()
            rest = process.communicate(timeout=PATIENCE)[0]
        self.assertNotIn("Traceback", "".join(said) + rest)

    name = re.sub(r"[^a-z0-9]+", "_", " ".join([executable] + arguments).lower()).strip("_")
    setattr(TestWrongStart, f"test_taken_{name}", test)


def start(executable, arguments):
    """Start an executable under a name of its own, since parameters outlive their node."""
    return subprocess.Popen(
        [program(executable), *arguments, f"__name:=case_{next(NUMBERS)}"], stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, universal_newlines=True,
    )


def run(executable, arguments):
    """Return the exit status and output of an executable that should end by itself."""
    process = start(executable, arguments)
    try:
        output = process.communicate(timeout=PATIENCE)[0]
    except subprocess.TimeoutExpired:
        process.terminate()
        raise AssertionError(
            f"{executable} {arguments} did not end within {PATIENCE} s:\n{process.communicate()[0]}"
        ) from None
    return process.returncode, output


for case in WRONG:
    add_test(*case)
for case in TAKEN:
    add_test_of_taken(*case)

if __name__ == "__main__":
    rospy.init_node("wrong_start_test")
    rostest.rosrun("mbf_relay", "wrong_start", TestWrongStart, sys.argv)
