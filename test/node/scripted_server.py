#!/usr/bin/env python3
"""A Move Base Flex server that does what each goal tells it to, for tests of whoever talks to one.

A goal's `position.z` names the script, see SCRIPTS; `position.x` is handed back in feedback, to tell goals apart. It
knows nothing of this package: actionlib's own server, and the messages.
"""

import sys
import threading

import actionlib
import rospy
from dynamic_reconfigure.encoding import decode_config, encode_config
from dynamic_reconfigure.msg import Config
from dynamic_reconfigure.srv import Reconfigure, ReconfigureResponse
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import (
    ExePathResult,
    GetPathAction,
    GetPathResult,
    MoveBaseAction,
    MoveBaseFeedback,
    MoveBaseResult,
    RecoveryActionGoal,
    RecoveryGoal,
)
from nav_msgs.msg import OccupancyGrid
from ros_testing import wait_until
from std_msgs.msg import String
from std_srvs.srv import Empty, EmptyResponse

SCRIPTS = {
    "arrive": 0.0,
    "drive": 1.0,  # feedback for ever, until cancelled or replaced
    "no_plan": 2.0,
    "no_control": 3.0,
    "oscillate": 4.0,
    "reject": 5.0,
    "cancel_unasked": 6.0,  # with INVALID_PLUGIN, as the C++ server does
    "wrong_success": 7.0,  # SUCCEEDED with a failure's outcome
    "empty_result": 8.0,  # ABORTED with a result nobody filled
    "ignore_cancel": 9.0,
    "silent": 10.0,  # accepted, then nothing, not even an answer to a cancel
    "die": 11.0,
    "recover": 12.0,  # sends itself a recovery goal, then arrives
}
NAMES = {number: name for name, number in SCRIPTS.items()}


class ScriptedServer:
    """The server; `~report` tells what reaches it."""

    def __init__(self):
        self.report = rospy.Publisher("~report", String, queue_size=1000, latch=False)
        wait_until(self.report.get_num_connections, "who reads the report, before anything can be told in it")
        self.recoveries = rospy.Publisher("~recovery/goal", RecoveryActionGoal, queue_size=10)
        self.costmap = rospy.Publisher("~global_costmap/costmap", OccupancyGrid, queue_size=1, latch=True)
        grid = OccupancyGrid(data=[0, 100, -1, 50])
        grid.info.width = grid.info.height = 2
        self.costmap.publish(grid)
        self.settings = {"controller_frequency": 10.0, "planner_frequency": 1.0, "planner_patience": 7.0}
        self.updates = rospy.Publisher("~parameter_updates", Config, queue_size=1, latch=True)
        self.updates.publish(encode_config(self.settings))
        rospy.Service("~set_parameters", Reconfigure, self.reconfigure)
        rospy.Service("~clear_costmaps", Empty, self.clear)
        self.running = None
        self.lock = threading.RLock()
        self.move_base = actionlib.ActionServer(
            "~move_base", MoveBaseAction, self.take_goal, self.take_cancel, auto_start=False)
        self.get_path = actionlib.ActionServer("~get_path", GetPathAction, self.plan, auto_start=False)
        self.move_base.start()
        self.get_path.start()

    def say(self, *words):
        self.report.publish(" ".join(str(word) for word in words))

    def reconfigure(self, request):
        changes = decode_config(request.config)
        self.settings.update(changes)
        self.say("reconfigure", sorted(changes.items()))
        self.updates.publish(encode_config(self.settings))
        return ReconfigureResponse(encode_config(self.settings))

    def clear(self, _request):
        self.say("clear")
        return EmptyResponse()

    def plan(self, handle):
        handle.set_accepted()
        goal, result = handle.get_goal(), GetPathResult()
        self.say("plan", goal.use_start_pose, goal.concurrency_slot, goal.target_pose.pose.orientation.w, goal.planner)
        if NAMES.get(goal.target_pose.pose.position.z) == "no_plan":
            result.outcome = GetPathResult.NO_PATH_FOUND
            handle.set_aborted(result, "no path")
            return
        result.path.header.frame_id = "map"
        for x in (0.0, goal.target_pose.pose.position.x):
            pose = PoseStamped()
            pose.header.frame_id, pose.pose.position.x, pose.pose.orientation.w = "map", x, 1.0
            result.path.poses.append(pose)
        handle.set_succeeded(result)

    def take_goal(self, handle):
        goal = handle.get_goal()
        script = NAMES[goal.target_pose.pose.position.z]
        self.say("goal", script, goal.target_pose.pose.position.x, goal.planner, goal.controller)
        if script == "reject":
            handle.set_rejected(
                MoveBaseResult(outcome=GetPathResult.INVALID_PLUGIN, message="no such planner"), "rejected"
            )
            return
        with self.lock:
            replaced, self.running = self.running, handle
            if replaced is not None:
                replaced.set_canceled(MoveBaseResult(outcome=MoveBaseResult.CANCELED), "replaced")
        handle.set_accepted()
        if script == "die":
            threading.Timer(0.1, lambda: __import__("os")._exit(9)).start()
        if script == "recover":
            self.recoveries.publish(RecoveryActionGoal(goal=RecoveryGoal(behavior="rotate")))
        self.feedback(handle, 0)
        if script not in ("drive", "ignore_cancel", "silent", "die"):
            self.end(handle, script)

    def feedback(self, handle, count):
        feedback = MoveBaseFeedback()
        feedback.current_pose.header.frame_id = "map"
        feedback.current_pose.pose.position.x = handle.get_goal().target_pose.pose.position.x
        feedback.current_pose.pose.position.y = float(count)
        handle.publish_feedback(feedback)
        if self.runs(handle) and NAMES[handle.get_goal().target_pose.pose.position.z] in ("drive", "ignore_cancel"):
            threading.Timer(0.02, self.feedback, (handle, count + 1)).start()

    def end(self, handle, script):
        self.forget(handle)
        failures = {
            "no_plan": (GetPathResult.NO_PATH_FOUND, "no way there"),
            "no_control": (ExePathResult.PAT_EXCEEDED, "no command for 5 s"),
            "oscillate": (MoveBaseResult.OSCILLATION, "to and fro"),
            "empty_result": (0, ""),
        }
        if script in failures:
            handle.set_aborted(MoveBaseResult(outcome=failures[script][0], message=failures[script][1]), "aborted")
        elif script == "cancel_unasked":
            handle.set_canceled(MoveBaseResult(outcome=ExePathResult.INVALID_PLUGIN, message="no such controller"), "")
        elif script == "wrong_success":
            handle.set_succeeded(MoveBaseResult(outcome=ExePathResult.COLLISION, message="hit something"), "")
        else:
            handle.set_succeeded(MoveBaseResult(outcome=MoveBaseResult.SUCCESS, message="arrived"), "arrived")

    def take_cancel(self, handle):
        script = NAMES[handle.get_goal().target_pose.pose.position.z]
        self.say("cancel", script, handle.get_goal().target_pose.pose.position.x)
        if script in ("ignore_cancel", "silent"):
            return
        self.forget(handle)
        handle.set_canceled(MoveBaseResult(outcome=MoveBaseResult.CANCELED, message="cancelled"), "cancelled")

    def forget(self, handle):
        with self.lock:
            if self.runs(handle):
                self.running = None

    def runs(self, handle):
        return self.running is not None and self.running.get_goal_id().id == handle.get_goal_id().id


if __name__ == "__main__":
    rospy.init_node("move_base_flex", argv=sys.argv)
    ScriptedServer()
    rospy.spin()
