#!/usr/bin/env python3
"""Single goals through move_base and Move Base Flex: the tutorial's, and those that must be turned down."""

import math
import os
import sys
import unittest

import dynamic_reconfigure.client
import numpy as np
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from mbf_msgs.msg import GetPathResult
from mbf_msgs.msg import MoveBaseAction as FlexAction
from mbf_msgs.msg import MoveBaseGoal as FlexGoal
from mbf_msgs.msg import MoveBaseResult as FlexResult
from move_base_msgs.msg import MoveBaseAction, MoveBaseActionFeedback, MoveBaseGoal, RecoveryStatus
from std_msgs.msg import Bool
from std_srvs.srv import Trigger

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from ros_testing import Listener, wait_until  # noqa: E402
from running_stack import Witness, run_client, start_test_node  # noqa: E402

from mbf_relay.ros.common.actions.action_client import ActionClient  # noqa: E402
from mbf_relay.ros.common.outcome_codes import name_of  # noqa: E402

NAN = float("nan")
UPRIGHT = (0.0, 0.0, 0.0, 1.0)
BAD_GOALS = {
    "a position that is not a number": ((NAN, 0.0), UPRIGHT, "map", "INVALID_GOAL", []),
    "a position without end": ((0.5, math.inf), UPRIGHT, "map", "INVALID_GOAL", []),
    "a quaternion of zeros": ((0.5, 0.0), (0.0, 0.0, 0.0, 0.0), "map", "INVALID_GOAL", []),
    "a quaternion that is not a number": ((0.5, 0.0), (0.0, 0.0, NAN, 1.0), "map", "INVALID_GOAL", []),
    "a frame nobody knows": ((0.5, 0.0), UPRIGHT, "atlantis", "TF_ERROR", []),
    "a place outside the map": ((500.0, 0.0), UPRIGHT, "map", "OUT_OF_MAP", []),
    "a place in a wall of a pillar": (
        (1.025, 1.1), UPRIGHT, "map", "BLOCKED_GOAL", ["clear_costmap"]),
}
"""What is wrong: position, quaternion, frame, outcome, and the recovery behaviours that are tried."""
PATIENCE = 60.0
"""Wall seconds a goal that cannot be reached may take, recovery behaviours included."""
STATUSES = (
    "simulator: simulation", "map_server: map", "amcl: Standard deviation", "amcl: scans", "move_base_flex: navigation",
    "move_base_flex: local costmap", "move_base_flex: global costmap", "move_base: relay",
)
WELL = (DiagnosticStatus.OK, DiagnosticStatus.WARN)
"""A machine that cannot keep up is warned of, and no fault of the nodes."""
SHIFT = 0.03
"""Metres the robot may move while it is told to go nowhere: nothing but the noise of standing."""


def pose_of(position, quaternion, frame):
    pose = PoseStamped(pose=Pose(Point(*position, 0.0), Quaternion(*quaternion)))
    pose.header.frame_id, pose.header.stamp = frame, rospy.get_rostime()
    return pose


class TestGoals(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.witness = Witness()
        cls.move_base = ActionClient("move_base", MoveBaseAction)
        cls.flex = ActionClient("move_base_flex/move_base", FlexAction)
        cls.recoveries = Listener("move_base_flex/recovery_status", RecoveryStatus, connected=True)
        for client in (cls.move_base, cls.flex):
            assert client.wait_for_server(60.0), f"waited 60 s for {client.name}, in vain"

    def test_1_the_tutorials_single_goal_is_reached(self):
        run = run_client("movebase_client.py")
        self.assertEqual(run.status, 0, run.output)
        self.assertIn("Goal execution done!", run.output)
        self.assertLess(self.witness.way_to(0.5, 0.0), 0.15)
        self.assertEqual(self.witness.touched(), [])
        self.assertEqual(self.witness.warnings(), [])

    def test_5_a_paused_drive_stands_and_keeps_its_goal_and_goes_on(self):
        paused = Listener("move_base_flex/paused", Bool, connected=True)
        feedback = Listener("move_base/feedback", MoveBaseActionFeedback, connected=True)
        start = self.witness.pose
        sent = self.move_base.send(MoveBaseGoal(pose_of((start.x - 1.0, start.y), (0.0, 0.0, 1.0, 0.0), "map")))
        wait_until(lambda: abs(self.witness.pose.x - start.x) > 0.1, "the robot to be on its way", 60.0)
        self.assertTrue(rospy.ServiceProxy("move_base/pause", Trigger)().success)
        paused.wait_for(lambda m: m.data, "the pause to be told")
        since = self.wait_for_rest()
        heard = len(feedback.messages)
        wait_until(lambda: len(feedback.messages) > heard + 50, "five seconds' feedback of a robot that stands", 60.0)
        where = self.witness.pose
        self.assertLess(math.hypot(where.x - since.x, where.y - since.y), SHIFT)
        self.assertIsNone(sent.ending)
        self.assertTrue(rospy.ServiceProxy("move_base/resume", Trigger)().success)
        ending = sent.wait(PATIENCE)
        self.assertEqual((ending.status, ending.text), (GoalStatus.SUCCEEDED, "Goal reached."))
        self.assertLess(math.hypot(self.witness.pose.x - start.x + 1.0, self.witness.pose.y - start.y), 0.2)

    def test_6_a_robot_whose_commands_come_late_arrives_and_server_and_guard_know_how_late(self):
        heard = Listener("/diagnostics", DiagnosticArray)
        faults = dynamic_reconfigure.client.Client("simulator/faults", timeout=10.0)
        self.addCleanup(faults.update_configuration, {"command_delay": 0.0})
        faults.update_configuration({"command_delay": 0.6})
        start = self.witness.pose
        ending = self.move_base.send(MoveBaseGoal(pose_of((0.5, 0.0), (0.0, 0.0, 0.0, 1.0), "map"))).wait(PATIENCE)
        self.assertEqual((ending.status, ending.text), (GoalStatus.SUCCEEDED, "Goal reached."))
        self.assertGreater(math.hypot(start.x - 0.5, start.y), 0.5, "it was there already")
        self.assertLess(self.witness.way_to(0.5, 0.0), 0.15)
        told = [status for message in heard.messages for status in message.status]
        for name in ("move_base_flex: navigation", "velocity_guard: velocities"):
            late = [
                float(value.value) for status in told for value in status.values
                if status.name == name and value.key == "velocities take effect after [s]"
            ]
            self.assertGreater(max(late), 0.4, name)
        self.assertEqual(self.witness.touched(), [])

    def wait_for_rest(self):
        """Return the robot's pose once it has stood for half a second of its own time."""

        def stands():
            way = self.witness.trajectory
            return np.ptp(way[way[:, 0] >= way[-1, 0] - 0.5, 1:3], axis=0).max() < 1e-3

        wait_until(stands, "the robot to stand", 30.0, period=0.5)
        return self.witness.pose

    def test_4_every_node_says_how_it_fares(self):
        heard = Listener("/diagnostics", DiagnosticArray)

        def level(name):
            statuses = [
                status for message in list(heard.messages)[-20:] for status in message.status if status.name == name
            ]
            return statuses[-1].level if statuses else None

        for name in STATUSES:
            wait_until(lambda: level(name) in WELL, f"'{name}' to be well", 20.0)
        faults = dynamic_reconfigure.client.Client("simulator/faults", timeout=10.0)
        faults.update_configuration({"lidar_silent": True})
        for name in ("move_base_flex: local costmap", "move_base_flex: global costmap", "amcl: scans"):
            wait_until(lambda: level(name) == DiagnosticStatus.ERROR, f"'{name}' to miss the scan", 20.0)
        faults.update_configuration({"lidar_silent": False})
        for name in STATUSES:
            wait_until(lambda: level(name) in WELL, f"'{name}' to be well again", 20.0)

    def end(self, client, goal, recoveries):
        """Send a goal that must not move the robot, check what was tried, and return how it ended."""
        before, tried = self.witness.pose, len(self.recoveries.messages)
        ending = client.send(goal).wait(PATIENCE)
        self.assertIsNotNone(ending, f"waited {PATIENCE} s for the end of a goal of {client.name}, in vain")
        after = self.witness.pose
        self.assertLess(math.hypot(after.x - before.x, after.y - before.y), SHIFT)
        # these come another way than the goal's end
        wait_until(lambda: len(self.recoveries.messages) >= tried + len(recoveries), f"{recoveries} to be told")
        self.assertEqual([status.recovery_behavior_name for status in self.recoveries.messages[tried:]], recoveries)
        return ending


def add_tests(words, position, quaternion, frame, outcome, recoveries):
    def through_move_base(self):
        ending = self.end(self.move_base, MoveBaseGoal(pose_of(position, quaternion, frame)), recoveries)
        self.assertIn(ending.status, (GoalStatus.ABORTED, GoalStatus.REJECTED))
        self.assertNotEqual(ending.text, "")

    def through_move_base_flex(self):
        ending = self.end(self.flex, FlexGoal(target_pose=pose_of(position, quaternion, frame)), recoveries)
        self.assertIn(ending.status, (GoalStatus.ABORTED, GoalStatus.REJECTED))
        code = ending.result.outcome
        self.assertIn(outcome, (name_of(code, FlexResult), name_of(code, GetPathResult)), ending.result.message)
        self.assertNotEqual(ending.result.message, "")

    name = words.replace(" ", "_")
    setattr(TestGoals, f"test_2_move_base_turns_down_{name}", through_move_base)
    setattr(TestGoals, f"test_3_move_base_flex_turns_down_{name}", through_move_base_flex)


for case, values in BAD_GOALS.items():
    add_tests(case, *values)

if __name__ == "__main__":
    start_test_node("goals_test")
    rostest.rosrun("mbf_relay", "goals", TestGoals)
