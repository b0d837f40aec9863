#!/usr/bin/env python3
"""The demo as a user runs it: a clean drive with its report, and Ctrl-C at any moment."""

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import unittest
import uuid

import psutil
import rostest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from programs import program  # noqa: E402
from ros_testing import LOOK_PERIOD, wait_until  # noqa: E402
from running_stack import OF_THE_MACHINE  # noqa: E402
from web_client import WebClient  # noqa: E402

from mbf_relay.ros.tools.demo_graph import descendants  # noqa: E402

MARK = "MBF_RELAY_DEMO_TEST"
PATIENCE = 240.0
OF_ROS_CPP = ("rosout", "robot_state_publisher")
"""ROS's own nodes in C++ take requests on every interface, whatever they are told; topics they send on loopback alone.
"""
FIGURES = (
    "success", "goals_reached", "contacts", "sim_time", "wall_time", "path_length", "localization_error_mean",
    "localization_error_max", "versions", "seed", "parameters",
)


class Demo:
    """A running demo whose processes, however deep, carry a mark in their environment."""

    def __init__(self, *options: str) -> None:
        self.mark = uuid.uuid4().hex
        # among the results of the tests, which the next run empties
        self.folder = tempfile.mkdtemp(prefix="demo test ", dir=os.environ.get("MBF_RELAY_TEST_RESULTS"))
        self.log = os.path.join(self.folder, "demo.log")
        with open(self.log, "wb") as stream:
            self.process = subprocess.Popen(
                [program("demo.py"), "--no-rviz", "--report", self.folder, *options],
                stdout=stream, stderr=subprocess.STDOUT, env=dict(os.environ, **{MARK: self.mark}),
            )

    @property
    def output(self) -> str:
        """What it has printed."""
        with open(self.log, encoding="utf-8") as stream:
            return stream.read()

    def wait_for(self, words: str) -> None:
        """Wait until it has printed some words."""
        def printed() -> bool:
            ended = self.process.poll() is not None  # looked at first: it may print them and end
            assert words in self.output or not ended, f"it ended before it said '{words}':\n{self.output}"
            return words in self.output

        wait_until(printed, f"'{words}' from the demo, which logs to {self.log}", PATIENCE)

    def left_behind(self) -> list:
        """Return the processes that carry its mark and still run."""
        found = []
        for entry in filter(str.isdigit, os.listdir("/proc")):
            try:
                with open(f"/proc/{entry}/environ", "rb") as stream:
                    if f"{MARK}={self.mark}".encode() in stream.read():
                        found.append(int(entry))
            except OSError:
                pass
        return found


class TestDemo(unittest.TestCase):
    driving = None
    """A demo that drives and shows its page: one for all tests that look at one, until a test ends it."""

    @classmethod
    def tearDownClass(cls):
        if cls.driving is not None and cls.driving.process.poll() is None:
            cls.driving.process.send_signal(signal.SIGINT)
            cls.driving.process.wait(60.0)

    def drive(self):
        """Return the demo that drives; start one where there is none."""
        cls = type(self)
        if cls.driving is None or cls.driving.process.poll() is not None:
            cls.driving = Demo("--speed", "4", "--web", "--laps", "99")
            cls.driving.wait_for("goal 1 of")
        return cls.driving

    def test_1_a_drive_leaves_a_report_and_nothing_else(self):
        demo = Demo("--speed", "4", "--seed", "5", "--relay", "server")
        self.assertEqual(demo.process.wait(PATIENCE), 0, demo.output)
        self.assertIn("Drove circle with result: True", demo.output)
        self.assertEqual(demo.left_behind(), [])
        with open(os.path.join(demo.folder, "report.json"), encoding="utf-8") as stream:
            figures = json.load(stream)
        for name in FIGURES:
            self.assertIn(name, figures)
        self.assertTrue(figures["success"])
        self.assertEqual((figures["goals_reached"], figures["contacts"], figures["seed"]), (8, 0, 5))
        self.assertGreater(figures["path_length"], 11.0)
        self.assertLess(figures["localization_error_max"], 0.3)
        with open(os.path.join(demo.folder, "report.png"), "rb") as stream:
            self.assertEqual(stream.read(8), b"\x89PNG\r\n\x1a\n")
        self.assertEqual(warnings(os.path.join(demo.folder, "log", "roslaunch.log")), [])

    def test_2_an_interrupt_ends_it_while_it_starts(self):
        demo = Demo()
        demo.wait_for("starting")
        self.interrupt(demo, signal.SIGINT)

    def test_3_an_interrupt_ends_it_while_nodes_come_up(self):
        demo = Demo()
        demo.wait_for("starting")
        wait_until(lambda: len(nodes_below(demo.process.pid)) >= 4, "nodes to come up", PATIENCE)
        self.interrupt(demo, signal.SIGTERM)

    def test_4_two_interrupts_end_it_while_it_drives(self):
        demo = self.drive()
        demo.process.send_signal(signal.SIGINT)
        self.interrupt(demo, signal.SIGINT)

    def test_4_a_demo_that_is_killed_leaves_nothing_behind(self):
        demo = self.drive()
        demo.process.kill()
        demo.process.wait()
        wait_until(lambda: demo.left_behind() == [], "everything the demo had started to end", 120.0, LOOK_PERIOD)

    def test_4_it_listens_on_the_loopback_interface_alone(self):
        demo = self.drive()
        listening = set()
        for pid in demo.left_behind():
            with contextlib.suppress(psutil.NoSuchProcess):  # it has ended since
                process = psutil.Process(pid)
                if process.name() not in OF_ROS_CPP:
                    listening.update(c.laddr.ip for c in process.connections() if c.status == psutil.CONN_LISTEN)
        self.assertEqual(listening, {"127.0.0.1"})

    def test_4_a_page_shows_the_robot_drive(self):
        demo = self.drive()
        demo.wait_for("see it at http://127.0.0.1:")
        port = int(re.search(r"see it at http://127.0.0.1:(\d+)/", demo.output).group(1))
        client = WebClient(port)
        client.layer("map", timeout=PATIENCE)
        client.layer("state", lambda state: state["goal"]["driving"], "of a drive", PATIENCE)
        client.close()

    def interrupt(self, demo, number):
        demo.process.send_signal(number)
        self.assertEqual(demo.process.wait(60.0), 130, demo.output)
        self.assertNotIn("Traceback", demo.output)
        self.assertEqual(demo.left_behind(), [])

    def test_5_wrong_options_are_told(self):
        for name, value, words in (
                ("--speed", "0", "is 0"), ("--laps", "0", "is below 1"), ("--relay", "x", "choice: 'x'")):
            demo = Demo(name, value)
            self.assertEqual(demo.process.wait(60.0), 2, demo.output)
            self.assertIn(name, demo.output)
            self.assertIn(words, demo.output)

    def test_6_a_folder_that_cannot_be_made_is_named(self):
        demo = Demo("--report", "/proc/report")
        self.assertEqual(demo.process.wait(60.0), 1, demo.output)
        self.assertIn("/proc/report", demo.output)
        self.assertNotIn("Traceback", demo.output)

    def test_6_a_file_where_the_logs_go_is_named_before_anything_starts(self):
        folder = tempfile.mkdtemp(dir=os.environ.get("MBF_RELAY_TEST_RESULTS"))
        path = os.path.join(folder, "log")
        open(path, "w").close()
        demo = Demo("--report", folder)
        self.assertEqual(demo.process.wait(60.0), 1, demo.output)
        self.assertIn(path, demo.output)
        self.assertNotIn("starting", demo.output)
        self.assertNotIn("Traceback", demo.output)


def nodes_below(pid):
    """Return the processes below another that are nodes by now, and no longer roslaunch about to become one."""
    found = set()
    for below in descendants(pid):
        with contextlib.suppress(psutil.Error):
            if any(word.startswith("__name:=") for word in psutil.Process(below).cmdline()):
                found.add(below)
    return found


def warnings(log):
    """Return the lines of a log with a warning, an error or a traceback."""
    with open(log, encoding="utf-8", errors="replace") as stream:
        lines = [line for line in stream if any(word in line for word in ("[WARN]", "[ERROR]", "[FATAL]", "Traceback"))]
    return [line for line in lines if not any(words in line for words in OF_THE_MACHINE)]


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "demo", TestDemo)
