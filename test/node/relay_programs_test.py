#!/usr/bin/env python3
"""Programs around the relay: one that is stopped, the one for the goal topic alone, and the tutorials' clients."""

import contextlib
import os
import signal
import subprocess
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import MoveBaseActionResult
from move_base_msgs.msg import MoveBaseActionGoal
from move_base_msgs.msg import MoveBaseActionResult as Result
from node.relay_case import RelayCase
from node.scripted_server import SCRIPTS
from programs import program
from ros_testing import Listener, connected_publisher, wait_until


@contextlib.contextmanager
def started(executable, *arguments):
    """Run a node of the package as `move_base`; end it in the end."""
    process = subprocess.Popen([program(executable), *arguments])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


class RelayProgramsTest(RelayCase):
    def test_a_relay_that_is_stopped_cancels_and_says_so(self):
        self.make_sure_of_server()
        results = Listener("second/move_base/result", Result)
        with started("move_base_relay", "__ns:=second", "_server:=/move_base_flex") as relay:
            goals = connected_publisher("second/move_base/goal", MoveBaseActionGoal)
            wait_until(lambda: results.publishers, "the second relay")
            self.send("drive", x=91.0, goals=goals)
            wait_until(lambda: self.reported("goal drive 91.0"), "the goal at the server")
            relay.send_signal(signal.SIGINT)
            end = results.wait_for(lambda m: True, "the end").status
            self.assertEqual((end.status, end.text),
                             (GoalStatus.ABORTED, "Aborting on the goal because the node has been killed"))
            wait_until(lambda: self.reported("cancel drive 91.0"), "the cancel at the server")
            self.assertEqual(relay.wait(20.0), 0)

    def test_a_second_relay_beside_one_that_works_ends_and_says_which(self):
        """Each goal went to both, which replaced each other's at the server: it ended LOST, or PREEMPTED by itself."""
        self.make_sure_of_server()
        relay = subprocess.run([program("move_base_relay"), "__name:=another"], stderr=subprocess.PIPE, text=True)
        self.assertEqual(relay.returncode, 1)
        self.assertIn("/move_base serves the action /move_base already", relay.stderr)

    def test_a_relay_that_ends_leaves_wishes_and_takes_what_it_showed(self):
        self.make_sure_of_server()
        shown, wish = "/fourth/move_base/controller_frequency", "/fourth/move_base/oscillation_timeout"
        arguments = ("__ns:=fourth", "_server:=/move_base_flex", "_oscillation_timeout:=7.0")
        with started("move_base_relay", *arguments) as relay:
            wait_until(lambda: rospy.get_param(shown, None) == 10.0, "the server's frequency to be shown")
            relay.send_signal(signal.SIGINT)
            self.assertEqual(relay.wait(20.0), 0)
        self.assertFalse(rospy.has_param(shown), "the next relay would forward it as a user's wish")
        self.assertEqual(rospy.get_param(wish), 7.0)

    def test_the_goal_topic_alone(self):
        self.make_sure_of_server()
        outcomes = Listener("third/move_base/navigation_outcome", MoveBaseActionResult)
        with started("mb_relay_subscriber.py", "__ns:=third", "_server:=/move_base_flex"):
            simple = connected_publisher("third/move_base_simple/goal", PoseStamped)

            def send(script, number):
                pose = PoseStamped()
                pose.header.frame_id, pose.header.stamp = "map", rospy.Time.from_sec(self.now + number)
                pose.pose.position.z, pose.pose.orientation.w = SCRIPTS[script], 1.0
                simple.publish(pose)

            def end_of(number):
                stamp = rospy.Time.from_sec(self.now + number)
                return outcomes.wait_for(
                    lambda m: m.status.goal_id.stamp == stamp, f"the outcome of goal {number}"
                ).status.status

            wait_until(
                lambda: (send("arrive", 0), outcomes.last)[1], "the third relay to say how goals end", period=0.2
            )
            send("drive", 1)
            send("no_plan", 2)
            self.assertEqual([end_of(1), end_of(2)], [GoalStatus.PREEMPTED, GoalStatus.ABORTED])
            send("arrive", 3)
            self.assertEqual(end_of(3), GoalStatus.SUCCEEDED)
            self.assertNotIn("/third/move_base/status", [name for name, _ in rospy.get_published_topics("/third")])

    def test_the_tutorials_clients_tell_by_their_exit_status(self):
        self.make_sure_of_server()
        self.assertIn("Drove circle with result: True", self.run_client("mb_relay_client.py", 0))
        self.assertIn("Drove circle with result: True", self.run_client("mb_relay_client.py", 0, "--via", "topic"))
        with started("waypoint_follower"):
            told = self.run_client("mb_relay_client.py", 0, "--via", "waypoints", "--laps", "2")
            self.assertIn("Drove circle with result: True", told)
        self.assertIn("Drove circle with result: True", self.run_client("mbf_goal_client.py", 0))
        self.run_client("movebase_client.py", 2, "nan")
        self.kill_server()
        self.assertIn("within 15 s", self.run_client("movebase_client.py", 1))

    def run_client(self, name, status, *arguments):
        """Run a client, check its exit status and return what it said."""
        done = subprocess.run(
            [program(name), *arguments],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            timeout=60.0,
            text=True,
        )
        self.assertEqual(done.returncode, status, done.stdout)
        return done.stdout


if __name__ == "__main__":
    rostest.rosrun("mbf_relay", "relay_programs", RelayProgramsTest)
