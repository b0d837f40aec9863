#!/usr/bin/env python3
"""The commands of the README, read out of it and run: the tutorial's circle, one's own map, world and parameters."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import rosgraph
import rostest

TEST = Path(os.path.abspath(__file__)).parents[1]
sys.path.insert(0, str(TEST))

from ros_testing import wait_until  # noqa: E402
from virtual_screen import VirtualScreen  # noqa: E402

ROOT = TEST.parent
FASTER = " real_time_factor:=3"
"""Added to the world's launch file, for the sake of the test's length; everything else is run word for word."""


def readme_commands():
    """Return the roslaunch and rosrun lines of the README's shell blocks."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```sh\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [line.split("#")[0].strip() for block in blocks for line in block.splitlines()]
    return [line for line in lines if line.startswith(("roslaunch ", "rosrun "))]


class TestReadme(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.commands = readme_commands()
        cls.folder = tempfile.TemporaryDirectory()
        cls.master = rosgraph.Master("/readme")

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def setUp(self):
        self.running = []

    def tearDown(self):
        for process in reversed(self.running):
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
        for process in self.running:
            process.wait(40.0)
        # A node ended while it starts stays on the master's list; the next test looks at that list.
        subprocess.run(["rosnode", "cleanup"], input=b"y\n", stdout=subprocess.DEVNULL, timeout=30.0, check=True)

    def nodes(self):
        publishers, subscribers, services = self.master.getSystemState()
        names = {name for _, users in publishers + subscribers + services for name in users}
        return {name for name in names if not name.startswith("/readme")}

    def command(self, *words):
        found = [line for line in self.commands if all(word in line for word in words)]
        self.assertEqual(len(found), 1, f"the README has {len(found)} commands with {words}")
        return found[0]

    def launch(self, command, *nodes, environment=None):
        """Start a command of the README and wait for the nodes it brings."""
        process = subprocess.Popen(
            ["bash", "-c", f"exec {command}"], cwd=self.folder.name, start_new_session=True,
            env=dict(environment or os.environ, PWD=self.folder.name),
        )
        self.running.append(process)

        def there():
            self.assertIsNone(process.poll(), f"'{command}' ended with status {process.returncode}")
            return self.nodes().issuperset(nodes)

        wait_until(there, f"{nodes} after '{command}'", 60.0)

    def run_to_end(self, command, timeout=120.0):
        done = subprocess.run(
            ["bash", "-c", command], cwd=self.folder.name, timeout=timeout, stdout=subprocess.PIPE, stderr=subprocess.STDOUT
        )
        output = done.stdout.decode(errors="replace")
        self.assertEqual(done.returncode, 0, f"'{command}' said:\n{output}")
        return output

    def test_1_the_tutorial_s_commands_drive_the_circle_and_save_a_map(self):
        self.launch(self.first("roslaunch mbf_relay turtlebot3_world.launch") + FASTER, "/simulator")
        self.launch(self.first("roslaunch mbf_relay amcl_demo_relay_server.launch"), "/amcl", "/move_base_flex", "/move_base")
        with VirtualScreen() as screen:
            self.launch(self.first("roslaunch mbf_relay rviz.launch"), "/rviz", environment=screen.environment)
            self.assertIn("Drove circle with result: True", self.run_to_end(self.first("rosrun mbf_relay mb_relay_client.py")))
            os.killpg(self.running[-1].pid, signal.SIGINT)
            self.running[-1].wait(40.0)
        self.run_to_end(re.search(r"`(rosrun mbf_relay map_saver[^`]*)`", (ROOT / "README.md").read_text()).group(1))
        self.assertTrue((Path(self.folder.name) / "my_map.yaml").is_file())

    def test_2_one_s_own_map_and_world_and_parameters_are_taken(self):
        shutil.copy(str(ROOT / "config" / "move_base_flex.yaml"), os.path.join(self.folder.name, "my_robot.yaml"))
        self.launch(self.command("turtlebot3_world.launch", "world:="), "/simulator")
        self.launch(self.command("map:="), "/map_server", "/amcl", "/move_base_flex")
        os.killpg(self.running[-1].pid, signal.SIGINT)
        self.running[-1].wait(40.0)
        self.launch(self.command("config:="), "/map_server", "/amcl", "/move_base_flex", "/move_base")

    def test_3_drives_without_ros_are_compared(self):
        worlds = json.loads((ROOT / "config" / "worlds" / "sample.json").read_text())
        worlds["worlds"] = worlds["worlds"][:1]
        (Path(self.folder.name) / "worlds.json").write_text(json.dumps(worlds))
        self.run_to_end(self.command("batch.py circle").replace("--seeds 100", "--seeds 1"))
        self.run_to_end("rosrun mbf_relay batch.py worlds.json")
        self.run_to_end(self.command("batch.py worlds.json"))
        self.run_to_end(self.command("compare.py"))

    def first(self, start):
        found = [line for line in self.commands if line.startswith(start)]
        self.assertTrue(found, f"the README has no command that starts with '{start}'")
        return min(found, key=len)


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "readme_commands", TestReadme)
