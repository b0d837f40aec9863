#!/usr/bin/env python3
"""The commands of the READMEs, read out of it and run: the tutorial's circle, one's own map, world and parameters."""

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import rosgraph
import rosnode
import rostest

TEST = Path(os.path.abspath(__file__)).parents[1]
sys.path.insert(0, str(TEST))

from programs import program  # noqa: E402
from readmes import block_with, command_with, first_command, run_to_end, texts  # noqa: E402
from ros_testing import LOOK_PERIOD, wait_until  # noqa: E402
from virtual_screen import RViz, VirtualScreen  # noqa: E402

from mbf_relay.maps import OCCUPIED, load_map  # noqa: E402

ROOT = TEST.parent
HALL = """<sdf version="1.6"><world name="hall"><model name="block"><static>true</static><pose>2 0 0.5 0 0 0</pose>
<link name="link"><collision name="all"><geometry><box><size>1 1 1</size></box></geometry></collision></link></model></world></sdf>
"""
FASTER = " real_time_factor:=4 command_patience:=3"
"""Added to the world's launch file, for the sake of the test's length; all but these two is run word for word."""
PATIENT = "{move_base: {silence_timeout: 3.0}}"
"""Parameters added to navigation's launch file: what a busy machine keeps waiting does not hang."""


class TestReadme(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.master = rosgraph.Master("/readme")
        # At four times real time it would tell of the wheels, and ask the master twice each time, 120 times a second.
        cls.master.setParam("/robot_state_publisher/publish_frequency", 1.0)  # of simulated time (Hz)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def setUp(self):
        self.running = []

    def tearDown(self):
        ended = [process.args[-1] for process in self.running if process.poll() is not None]
        for process in reversed(self.running):
            process.send_signal(signal.SIGINT)
        for process in self.running:
            process.wait(40.0)
        # A node ended while it starts stays on the master's list; the next test looks at that list.
        patience = socket.getdefaulttimeout()
        _, silent = rosnode.rosnode_ping_all(skip_cache=True)
        socket.setdefaulttimeout(patience)  # which rosnode sets
        rosnode.cleanup_master_blacklist(self.master, silent)
        self.assertFalse(ended, "these ended by themselves")

    def nodes(self):
        publishers, subscribers, services = self.master.getSystemState()
        names = {name for _, users in publishers + subscribers + services for name in users}
        return {name for name in names if not name.startswith("/readme")}

    def launch(self, command, *nodes, environment=None):
        """Start a command of the README and wait for the nodes it brings.

        It stays in this process's group: rostest interrupts that, and no tearDown runs then.
        """
        process = subprocess.Popen(
            ["bash", "-c", f"exec {command}"], cwd=self.folder.name,
            env=dict(environment or os.environ, PWD=self.folder.name),
        )
        self.running.append(process)

        def there():
            self.assertIsNone(process.poll(), f"'{command}' ended with status {process.returncode}")
            return self.nodes().issuperset(nodes)

        wait_until(there, f"{nodes} after '{command}'", 60.0, LOOK_PERIOD)

    def end_last(self):
        """End what was started last, as Ctrl-C does."""
        process = self.running.pop()
        self.assertIsNone(process.poll(), f"{process.args} ended by itself")
        process.send_signal(signal.SIGINT)
        process.wait(40.0)

    def run_to_end(self, command, environment=None):
        return run_to_end(command, self.folder.name, environment)

    def test_1_the_tutorial_s_commands_drive_the_circle_and_save_a_map(self):
        self.launch(first_command("roslaunch mbf_relay turtlebot3_world.launch") + FASTER, "/simulator")
        patient = Path(self.folder.name) / "patient.yaml"
        patient.write_text(PATIENT)
        self.launch(
            f"{first_command('roslaunch mbf_relay amcl_demo_relay_server.launch')} overrides:={patient}",
            "/amcl", "/move_base_flex", "/move_base",
        )
        self.launch(command_with("record.launch"), "/record")
        with VirtualScreen() as screen:
            rviz = RViz(
                screen, "navigation.rviz", os.path.join(self.folder.name, "rviz.log"),
                command=first_command("roslaunch mbf_relay rviz.launch").split(),
            )
            self.assertIn("/rviz", self.nodes())
            self.assertIn(
                "Drove circle with result: True", self.run_to_end(first_command("rosrun mbf_relay mb_relay_client.py"))
            )
            self.assertIsNone(rviz.process.poll(), "RViz ended by itself")
        self.end_last()
        self.run_to_end(command_with("drive_report.py"))
        report = json.loads((Path(self.folder.name) / "report.json").read_text())
        self.assertTrue(report["success"], report)
        self.assertEqual((report["goals_reached"], report["contacts"]), (8, 0), report)
        self.assertLess(report["localization_error_mean"], 0.05, report)
        self.run_to_end(re.search(r"`(rosrun mbf_relay map_saver[^`]*)`", "\n".join(texts().values())).group(1))
        self.assertTrue((Path(self.folder.name) / "my_map.yaml").is_file())

    def test_2_the_recorded_drive_is_localized_again_without_ros(self):
        shutil.copy(os.path.join(self.folder.name, "my_map.yaml"), os.path.join(self.folder.name, "map.yaml"))
        shutil.copy(str(ROOT / "config" / "amcl.yaml"), self.folder.name)
        self.run_to_end(command_with("bag_to_log.py"))
        self.run_to_end(command_with("localize_log.py", "--params"))
        self.run_to_end(command_with("localize_log.py", "--stress"))
        trajectory = np.loadtxt(os.path.join(self.folder.name, "result", "trajectory.csv"), delimiter=",", skiprows=1)
        self.assertLess(np.hypot(*(trajectory[-1, 1:3] - (-1.990, -0.508))), 0.1, "the circle ends where it began")

    def test_4_one_s_own_map_and_world_and_parameters_are_taken(self):
        shutil.copy(str(ROOT / "config" / "move_base_flex.yaml"), os.path.join(self.folder.name, "my_robot.yaml"))
        own = command_with("turtlebot3_world.launch", "world:=")  # of a building without a pillar in its middle
        self.launch(own.replace("x_pos:=0.0", "x_pos:=0.5").replace("y_pos:=0.0", "y_pos:=0.5"), "/simulator")
        self.launch(command_with("composed:=true"), "/map_server", "/amcl", "/move_base_flex", "/move_base")
        self.end_last()
        self.launch(command_with("map:=", "initial_pose_x:="), "/map_server", "/amcl", "/move_base_flex")
        self.end_last()
        self.launch(command_with("config:="), "/map_server", "/amcl", "/move_base_flex", "/move_base")

    def test_3_a_world_s_map_is_drawn(self):
        (Path(self.folder.name) / "my_hall.world").write_text(HALL)
        self.run_to_end(command_with("world_to_map.py"))
        drawn = load_map(os.path.join(self.folder.name, "my_hall.yaml"))
        self.assertAlmostEqual(
            (drawn.data == OCCUPIED).sum() * drawn.resolution, 4.0, delta=0.5, msg="the block's sides (m)"
        )

    def test_5_a_test_of_one_s_own_client_passes(self):
        package = Path(self.folder.name) / "src" / "my_package"
        package.mkdir(parents=True)
        (package / "package.xml").write_text("<package format='2'><name>my_package</name></package>")
        for name, language, word in (
            ("my_client.test", "xml", "my_client_test.py"),
            ("my_client_test.py", "python", "TestMyClient"),
        ):
            (package / name).write_text(block_with(language, word))
        (package / "my_client_test.py").chmod(0o755)
        environment = dict(os.environ, ROS_PACKAGE_PATH=f"{package.parent}:{os.environ['ROS_PACKAGE_PATH']}")
        self.assertIn("RESULT: SUCCESS", self.run_to_end("rostest my_package my_client.test", environment=environment))

    def test_6_a_planner_of_one_s_own_is_taken_with_ros_and_without(self):
        for name, language, word in (
            ("my_planners.py", "python", "class StraightLine("), ("straight.yaml", "yaml", "my_planners.StraightLine"),
        ):
            (Path(self.folder.name) / name).write_text(block_with(language, word))
        batch, launch = (
            line.replace("scripts/run --with . ", "") for line in block_with("sh", "straight.yaml").splitlines())
        environment = dict(os.environ, PYTHONPATH=f"{os.environ['PYTHONPATH']}:{self.folder.name}")
        said = self.run_to_end(batch.replace("--seeds 10", "--seeds 1"), environment=environment)
        self.assertIn("no straight way to", said)
        self.launch(launch, "/move_base_flex", environment=environment)
        self.assertFalse(self.master.hasParam("/simulator/x_pos"), "the robot starts where it did in an earlier world")
        wait_until(
            lambda: any(name.startswith("/move_base_flex/straight/") for name, _ in self.master.getPublishedTopics("")),
            "topics of the planner", 60.0, LOOK_PERIOD)

    def test_7_one_s_own_urdf_drives(self):
        """Of a robot's URDF the description alone was taken, and a burger drove under it."""
        shutil.copy(str(TEST / "launch_files" / "box_on_wheels.urdf"), os.path.join(self.folder.name, "my_robot.urdf"))
        self.run_to_end(command_with("robot_parameters.py", ".urdf"))
        self.launch(command_with("demo.launch", ".urdf") + FASTER, "/simulator", "/amcl", "/move_base_flex", "/move_base")
        client = shlex.quote(program("movebase_client.py"))
        self.assertIn("Goal execution done!", self.run_to_end(f"{client} -1.5 -0.5"))


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "readme_commands", TestReadme)
