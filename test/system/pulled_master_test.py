#!/usr/bin/env python3
"""The ROS master dies or hangs while the robot drives, and comes back: nobody is left driving, and goals work after.

The graph has a master of its own, for the one of this test must live. `--pair N` makes one trial of master and node
killed at once instead: what listens here does not know a second master, so that each trial is a process.
"""

import os
import random
import signal
import subprocess
import sys
import time
import urllib.parse
import uuid

import rospkg
import rospy
import rostest
from geometry_msgs.msg import Twist
from mbf_msgs.msg import MoveBaseActionResult as FlexResult
from mbf_msgs.msg import MoveBaseGoal as FlexGoal

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from pulled import SLOW, PulledCase, goal_at, pid_of  # noqa: E402
from ros_testing import LOOK_PERIOD, Listener, wait_until  # noqa: E402
from running_stack import run_client, start_test_node  # noqa: E402
from tally import trial  # noqa: E402

from mbf_relay.ros.tools.demo_graph import DemoGraph  # noqa: E402
from mbf_relay.simulation.arena import CIRCLE, START  # noqa: E402

LAUNCH = os.path.join(rospkg.RosPack().get_path("mbf_relay"), "test", "system", "robot_that_comes_back.launch")
INITIAL_POSE = (
    "rostopic", "pub", "-1", "/initialpose", "geometry_msgs/PoseWithCovarianceStamped",
    f"{{header: {{frame_id: map}}, "
    f"pose: {{pose: {{position: {{x: {START.x}, y: {START.y}}}, orientation: {{w: 1.0}}}}}}}}",
)
"""A user's command; this test's own node is unknown to the new master."""
EVERYBODY = ("/simulator", "/amcl", "/map_server", "/velocity_guard", "/move_base_flex", "/move_base")
NEEDED = {"/move_base": 0.25, "/move_base_flex": 0.25, "/velocity_guard": 0.25, "/amcl": 0.25}
"""What a drive cannot go on without, and the metres the robot may come at real time."""


def shows_the_server_s():
    """Return whether the relay has the server's settings among its parameters; until then they change by themselves."""
    there = rospy.get_param("/move_base", {})
    mirrored = there.get("mirrored")
    return mirrored and all(there.get(name) == value for name, value in mirrored.items())


class MasterCase(PulledCase):
    """The graph on a master that can be killed."""

    factor = 2.0
    """Simulated seconds per second."""

    @classmethod
    def setUpClass(cls):
        cls.folder = os.path.join(rospkg.get_log_dir(), "pulled_master")
        # an id of its own: roslaunch would wait for a roscore to make one
        launch = ["--wait", "--run_id", str(uuid.uuid4()), LAUNCH, f"real_time_factor:={cls.factor}"]
        cls.graph = DemoGraph(launch, cls.folder)
        os.environ.update(cls.graph.environment)
        cls.graph.__enter__()
        try:
            cls.start_master()
            cls.graph.wait_for_parameter("/use_sim_time", 60.0)
            start_test_node("pulled_master_test")
            super().setUpClass()
            cls.ends = Listener("move_base_flex/move_base/result", FlexResult, connected=True)
            cls.pids = {node: wait_until(lambda node=node: pid_of(node), node, 60.0, LOOK_PERIOD) for node in EVERYBODY}
            wait_until(shows_the_server_s, "the relay to show the server's settings", 60.0, LOOK_PERIOD)
            cls.given = {node: rospy.get_param(node) for node in EVERYBODY if node not in ("/amcl", "/map_server")}
            cls.foreigner = wait_until(lambda: pid_of("/robot_state_publisher"), "robot_state_publisher")
        except BaseException:
            cls.tearDownClass()
            raise

    @classmethod
    def tearDownClass(cls):
        cls.graph.__exit__()

    @classmethod
    def start_master(cls):
        port = urllib.parse.urlsplit(cls.graph.environment["ROS_MASTER_URI"]).port
        command = ["rosmaster", "--core", "-p", str(port)]
        cls.master = cls.graph.start(command, os.path.join(cls.folder, "master.log"))

    def setUp(self):
        for client in (self.client, self.flex) if self.master.poll() is None else (self.flex,):
            self.assertTrue(client.wait_for_server(60.0), f"waited 60 s for {client.name}, in vain")
        wait_until(lambda: self.speed() < SLOW, "the robot to stand")

    def kill(self, node):
        """Kill a node, which no master tells the process of any more."""
        self.ended = len(self.ends.messages)
        self.pulled_from, self.pulled_at, self.heard = self.witness.pose, time.monotonic(), len(self.commands.messages)
        os.kill(self.pids[node], signal.SIGKILL)

    def check_one_end(self, sent):
        """Expect the goal to end once: for its client where there is a relay, and for who watches the server."""
        wait_until(lambda: sent.ending or len(self.ends.messages) > self.ended, "the end of the goal", 60.0)
        ended = [end.status.goal_id.id for end in self.ends.messages]
        self.assertEqual(len(ended), len(set(ended)))

    def not_as_given(self, node):
        """Return which of a node's parameters are not as it had them; it is there before it has told the last."""
        there = rospy.get_param(node, {})
        return {name: there.get(name) for name, value in self.given[node].items() if there.get(name) != value}

    def check_all_is_as_before(self, place):
        """Expect all nodes at a new master, with what their user gave them, and that a user can send the robot on.

        Of amcl's parameters the pose moves on, and map_server has none.
        """
        for node in EVERYBODY:
            wait_until(lambda node=node: pid_of(node), f"{node} to be back", 90.0, LOOK_PERIOD)
        os.kill(self.foreigner, signal.SIGTERM)  # C++ nodes know nothing of new masters; their user starts them again
        for node in self.given:
            wait_until(
                lambda node=node: not self.not_as_given(node),
                lambda node=node: f"the parameters its user gave {node}, but for {self.not_as_given(node)}",
                period=LOOK_PERIOD)
        x, y = (str(value) for value in place[:2])

        def arrives():
            """Tell amcl where the new simulation begins, for the robot was carried there, and send a goal.

            One sent before the costmaps are there again ends with the words that they are not.
            """
            subprocess.run(INITIAL_POSE, stdout=subprocess.DEVNULL, timeout=60.0, check=True)
            return run_client("movebase_client.py", x, y).status == 0

        wait_until(arrives, "a goal to be reached", 180.0)


class TestPulledMaster(MasterCase):
    """Run in the order of their names; the last one leaves this node with a master that does not know it."""

    @trial("master killed and frozen")
    def test_1_a_frozen_master_keeps_no_drive_waiting(self):
        sent = self.drive(CIRCLE[0])
        self.master.send_signal(signal.SIGSTOP)
        try:
            self.check_arrival(sent, "the master was frozen")
            self.check_arrival(self.drive(CIRCLE[1]), "the master was frozen for long")
        finally:
            self.master.send_signal(signal.SIGCONT)

    @trial("master killed and frozen")
    def test_2_without_a_master_drives_end_and_can_be_called_off(self):
        sent = self.drive(CIRCLE[2])
        self.master.kill()
        self.master.wait()
        self.check_arrival(sent, "the master was killed")
        sent = self.drive(CIRCLE[3])
        sent.cancel()
        self.pulled_from, self.pulled_at, self.heard = self.witness.pose, time.monotonic(), len(self.commands.messages)
        self.check_told_to_stand("a cancel without a master", within=0.25)
        self.assertIsNotNone(sent.wait(10.0))

    @trial("master killed and frozen")
    def test_3_a_relay_that_dies_after_its_master_leaves_no_robot_driving(self):
        sent = self.drive(CIRCLE[4])
        self.kill("/move_base")
        self.check_told_to_stand("a relay killed without a master", self.factor * NEEDED["/move_base"])
        self.check_one_end(sent)

    @trial("master killed and frozen")
    def test_4_a_new_master_finds_a_robot_that_stands_and_the_next_goal_works(self):
        sent = self.flex.send(FlexGoal(target_pose=goal_at(CIRCLE[4]).target_pose))  # the relay waits for a master
        wait_until(lambda: self.speed() > 0.1 or sent.ending, "the robot to drive")
        self.assertIsNone(sent.ending)
        self.start_master()
        wait_until(lambda: self.commands.last == Twist(), "a zero as the last velocity")
        self.check_all_is_as_before(CIRCLE[0])


class TestMasterAndNodeKilled(MasterCase):
    """One pair, drawn by the trial's number: a node and the master die within a second, either first."""

    factor = 1.0

    def test_nobody_drives_on_and_the_next_goal_works(self):
        index = int(sys.argv[sys.argv.index("--pair") + 1])
        chance, node = random.Random(index), list(NEEDED)[index % len(NEEDED)]
        way, master_first = chance.uniform(0.0, 0.2), index // len(NEEDED) % 2 == 0
        what = f"master, then {node} killed" if master_first else f"{node}, then master killed"
        with trial("master and node killed within a second") as made:
            sent = self.drive(CIRCLE[4])
            if master_first:
                self.master.kill()
                self.wait_for_way(way, sent)
            self.kill(node)
            self.master.kill()
            self.check_told_to_stand(what, NEEDED[node], made)
            self.check_one_end(sent)
            self.master.wait()
            self.start_master()
            self.check_all_is_as_before(CIRCLE[0])


if __name__ == "__main__":
    case = TestMasterAndNodeKilled if "--pair" in sys.argv else TestPulledMaster
    rostest.rosrun("mbf_relay", "pulled_master", case)
