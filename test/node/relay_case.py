"""What the relay's tests share: the relay's topics, the clock, and a scripted server that can be killed."""

import os
import subprocess
import sys
import unittest

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
from geometry_msgs.msg import PoseStamped, Twist
from mbf_msgs.msg import MoveBaseActionResult
from move_base_msgs.msg import MoveBaseActionFeedback, MoveBaseActionGoal
from move_base_msgs.msg import MoveBaseActionResult as Result
from node.scripted_server import SCRIPTS
from ros_testing import Listener, connected_publisher, wait_until
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

SERVER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "scripted_server.py")
REPLACED = "This goal was canceled because another goal was recieved by the simple action server"


class RelayCase(unittest.TestCase):
    """A test in front of the relay, with a scripted server behind it.

    All of a file in one process, as connecting takes long.

    The clock is the test's own, and mostly stands: what the relay does must not depend on it.
    """

    @classmethod
    def setUpClass(cls):
        rospy.init_node("relay_test")
        cls.clock = rospy.Publisher("/clock", Clock, queue_size=1)
        cls.server = None
        rospy.set_param("move_base_flex/planners", [
            {"name": "navfn", "type": "navfn/NavfnROS"}, {"name": "GP", "type": "global_planner/GlobalPlanner"}])
        rospy.set_param("move_base_flex/controllers", [
            {"name": "first", "type": "our_planner/First"}, {"name": "DWA", "type": "dwa_local_planner/DWAPlannerROS"}])
        rospy.set_param("move_base_flex/recovery_behaviors", [
            {"name": "clear", "type": "x"}, {"name": "rotate", "type": "y"}])
        cls.report = Listener("move_base_flex/report", String)
        cls.results = Listener("move_base/result", Result, connected=True)
        cls.status = Listener("move_base/status", GoalStatusArray, connected=True)
        cls.feedback = Listener("move_base/feedback", MoveBaseActionFeedback, connected=True)
        cls.outcomes = Listener("move_base/navigation_outcome", MoveBaseActionResult, connected=True)
        cls.velocity = Listener("cmd_vel", Twist, connected=True)
        cls.current_goal = Listener("move_base/current_goal", PoseStamped, connected=True)
        cls.goals = connected_publisher("move_base/goal", MoveBaseActionGoal, queue_size=100)
        cls.cancels = connected_publisher("move_base/cancel", GoalID, queue_size=100)
        cls.number = 0
        cls.set_clock(100.0)
        cls.start_server()

    def setUp(self):
        self.set_clock(self.now + 10.0)

    @classmethod
    def tearDownClass(cls):
        cls.kill_server()

    @classmethod
    def set_clock(cls, seconds):
        cls.now = seconds
        message = Clock(rospy.Time.from_sec(seconds))

        def arrived():
            cls.clock.publish(message)
            told = cls.status.last  # the relay stamps it with what it takes for now
            return rospy.get_time() == seconds and told is not None and told.header.stamp.to_sec() == seconds

        wait_until(arrived, f"the clock to stand at {seconds}")

    @classmethod
    def start_server(cls):
        cls.server = subprocess.Popen([sys.executable, SERVER])
        wait_until(lambda: cls.report.publishers, "the server's report")

    @classmethod
    def kill_server(cls):
        if cls.server is not None:
            cls.server.kill()
            cls.server.wait()
            cls.server = None

    def make_sure_of_server(self):
        """Have a server that carries out goals."""
        if self.server is None or self.server.poll() is not None:
            wait_until(lambda: not self.report._subscriber.get_num_connections(), "the old server's end")
            self.start_server()

    def send(self, script, x=0.0, goal_id=None, stamp=None, quaternion_w=1.0, frame="map", goals=None):
        """Send an action goal and return its id."""
        type(self).number += 1
        message = MoveBaseActionGoal()
        message.goal_id.id = f"{type(self).__name__}-{self.number}" if goal_id is None else goal_id
        message.goal_id.stamp = rospy.Time.from_sec(self.now if stamp is None else stamp)
        pose = message.goal.target_pose
        pose.header.frame_id, pose.pose.position.x, pose.pose.position.z = frame, x, SCRIPTS[script]
        pose.pose.orientation.w = quaternion_w
        (goals or self.goals).publish(message)
        return message.goal_id.id

    def end_of(self, goal_id, timeout=10.0):
        """Wait for a goal's result and return its status."""
        return self.results.wait_for(
            lambda m: m.status.goal_id.id == goal_id, f"the result of {goal_id}", timeout
        ).status

    def wait_for_status(self, goal_id, status):
        self.status.wait_for(
            lambda m: any(s.goal_id.id == goal_id and s.status == status for s in m.status_list),
            f"{goal_id} in state {GoalStatus.to_string(status)}", 10.0)

    def wait_for_feedback(self, goal_id, count=1):
        wait_until(lambda: len([m for m in self.feedback.messages if m.status.goal_id.id == goal_id]) >= count,
                   f"{count} feedback of {goal_id}", 10.0)

    def reported(self, *words):
        return [m.data for m in self.report.messages if all(str(word) in m.data for word in words)]

    def wait_for_report(self, *words):
        """Return the server's first report with the words: it comes another way than a goal's end, and maybe later."""
        return self.report.wait_for(lambda m: all(str(word) in m.data for word in words), f"'{' '.join(words)}'").data

    def check_end(self, goal_id, status, text, timeout=10.0):
        end = self.end_of(goal_id, timeout)
        self.assertEqual((GoalStatus.to_string(end.status), end.text), (GoalStatus.to_string(status), text))
