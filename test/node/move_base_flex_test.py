#!/usr/bin/env python3
"""The server with its own plugins and costmaps, in a bare room that this test makes up: services, bad input, blindness.
"""

import itertools
import math
import os
import subprocess
import sys
import threading
import unittest

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), os.pardir))

import numpy as np
import rospy
import rostest
from actionlib_msgs.msg import GoalStatus
from diagnostic_msgs.msg import DiagnosticArray
from dynamic_reconfigure.client import Client as ReconfigureClient
from geometry_msgs.msg import PointStamped, PoseStamped
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mbf_msgs import srv
from mbf_msgs.msg import (
    ExePathGoal,
    GetPathGoal,
    MoveBaseGoal,
    RecoveryGoal,
)
from mbf_msgs.srv import CheckPath, CheckPathRequest, CheckPoint, CheckPose, CheckPoseRequest
from nav_msgs.msg import OccupancyGrid
from node.move_base_flex_case import BURGER, PADDING, STATES, MoveBaseFlexCase, is_zero, path_of, pose_at
from programs import program
from ros_testing import Listener, wait_until
from std_srvs.srv import Empty
from tally import LONG

from mbf_relay.costmap import inspection
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.costmap.outline import padded
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.ros.common.conversions import header, pose_from_message, pose_to_message

NAN, INF = float("nan"), float("inf")


class MoveBaseFlexTest(MoveBaseFlexCase):
    # bad input

    def test_1_nonsense_ends_in_its_outcome(self):
        bad_poses = {
            "quaternion (0.0, 0.0, 0.0, 0.0)": pose_at(1.0, quaternion=(0.0, 0.0, 0.0, 0.0)),
            "quaternion (nan": pose_at(1.0, quaternion=(NAN, 0.0, 0.0, 1.0)),
            "position (nan": pose_at(NAN), "position (1.0, inf)": pose_at(1.0, INF),
        }
        for words, pose in bad_poses.items():
            self.assert_outcome("get_path", GetPathGoal(target_pose=pose), "INVALID_GOAL", words=words)
            self.assert_outcome("move_base", MoveBaseGoal(target_pose=pose), "INVALID_GOAL", words=words)
            start = GetPathGoal(target_pose=pose_at(1.0), start_pose=pose, use_start_pose=True)
            self.assert_outcome("get_path", start, "INVALID_START", words=words)
            path = path_of(0.0, 0.1, 0.2)
            path.path.poses[2] = pose
            self.assert_outcome("exe_path", path, "INVALID_PATH", words="pose 2 of the path")
        self.assert_outcome("get_path", GetPathGoal(target_pose=pose_at(1e300)), "INVALID_GOAL", words="1e+300")
        self.assert_outcome("exe_path", path_of(1e300, 1e308), "INVALID_PATH", words="1e+300")
        for frame in ("atlantis", ""):
            self.assert_outcome("get_path", GetPathGoal(target_pose=pose_at(1.0, frame=frame)), "TF_ERROR", words=frame)
            self.assert_outcome(
                "move_base", MoveBaseGoal(target_pose=pose_at(1.0, frame=frame)), "TF_ERROR", words=frame
            )
            self.assert_outcome("exe_path", path_of(0.0, 1.0, frame=frame), "TF_ERROR", words=frame)
        self.assert_outcome("exe_path", ExePathGoal(), "INVALID_PATH", words="empty")
        for tolerance in (-1.0, NAN, INF):
            self.assert_outcome("get_path", GetPathGoal(target_pose=pose_at(1.0), tolerance=tolerance), "INVALID_GOAL")
            goal = path_of(0.0, 1.0)
            goal.tolerance_from_action, goal.dist_tolerance = True, tolerance
            self.assert_outcome("exe_path", goal, "FAILURE", words="dist_tolerance")
        unknown = {
            "get_path": GetPathGoal(target_pose=pose_at(1.0), planner="navfn/NavfnROS"),
            "exe_path": ExePathGoal(path=path_of(0.0, 1.0).path, controller="teb"),
            "recovery": RecoveryGoal(behavior="dance"),
            "move_base": MoveBaseGoal(target_pose=pose_at(1.0), planner="A*"),
        }
        for action, goal in unknown.items():
            self.assert_outcome(action, goal, "INVALID_PLUGIN", "REJECTED")
        self.assertTrue(all(map(is_zero, self.velocity.messages)))

    def test_2_the_planner_s_own_outcomes_come_through(self):
        client = ReconfigureClient("move_base_flex", timeout=20.0)
        client.update_configuration({"planner_max_retries": 0})
        self.assert_outcome("get_path", GetPathGoal(target_pose=pose_at(90.0)), "OUT_OF_MAP")
        self.assert_outcome("get_path", GetPathGoal(target_pose=pose_at(-2.98)), "BLOCKED_GOAL")
        blocked = GetPathGoal(target_pose=pose_at(1.0), start_pose=pose_at(-2.98), use_start_pose=True)
        self.assert_outcome("get_path", blocked, "BLOCKED_START")
        client.update_configuration({"planner_max_retries": -1})
        self.assert_outcome("get_path", GetPathGoal(target_pose=pose_at(-2.98)), "PAT_EXCEEDED")
        client.close()
        unnormalised = GetPathGoal(target_pose=pose_at(1.0, quaternion=(0.0, 0.0, -0.112, 0.999 * 40.0)))
        self.assert_outcome("get_path", unnormalised, "SUCCESS", "SUCCEEDED")
        odom = GetPathGoal(target_pose=pose_at(1.0, frame="/odom"))
        self.assert_outcome("get_path", odom, "SUCCESS", "SUCCEEDED")

    def test_3_random_goals_always_end_and_the_server_lives_on(self):
        numbers = st.one_of(st.floats(-4.0, 4.0), st.sampled_from([NAN, INF, -INF, 1e300, -1e-300, 0.0]))
        near = st.floats(-0.5, 0.5)
        quaternions = st.one_of(st.just((0.0, 0.0, 0.0, 1.0)), st.tuples(numbers, numbers, numbers, numbers))
        frames = st.sampled_from(["map", "map", "map", "odom", "/map", "atlantis", ""])
        poses = st.builds(pose_at, numbers, numbers, frames, quaternions)
        names = st.sampled_from(["", "", "NavfnROS", "DWAPlannerROS", "clear_costmap", "nobody", "\u00e9"])
        slots = st.integers(0, 255)
        paths = st.one_of(
            st.builds(lambda xs, frame: path_of(*xs, frame=frame).path, st.lists(near, max_size=5), frames),
            st.builds(lambda poses: path_of().path.__class__(poses=poses), st.lists(poses, max_size=5)),
        )
        tolerances = st.one_of(st.just(0.0), st.floats(0.0, 2.0), numbers)
        goals = st.one_of(
            st.tuples(
                st.just("get_path"), st.builds(GetPathGoal, st.booleans(), poses, poses, tolerances, names, slots)
            ),
            st.tuples(
                st.just("exe_path"),
                st.builds(
                    ExePathGoal,
                    paths,
                    names,
                    slots,
                    st.booleans(),
                    tolerances.map(np.float32),
                    tolerances.map(np.float32),
                ),
            ),
            st.tuples(
                st.just("recovery"), st.builds(RecoveryGoal, st.sampled_from(["clear_costmap", "nobody", ""]), slots)
            ),
            st.tuples(st.just("move_base"), st.builds(MoveBaseGoal, poses, names, names, st.lists(names, max_size=2))),
        )

        @given(goals, st.booleans())
        @settings(
            max_examples=1000 if LONG else 60, derandomize=not LONG, deadline=None, database=None,
            suppress_health_check=list(HealthCheck))
        def every_goal_ends(goal, cancel):
            action, message = goal
            sent = self.clients[action].send(message)
            if cancel:
                sent.cancel()
            ending = sent.wait(20.0)
            if ending is None:  # a drive may go on for longer than anybody waits
                sent.cancel()
                ending = sent.wait(10.0)
            self.assertIsNotNone(ending, f"waited in vain for the end of {action}: {message}")
            self.assertNotEqual(ending.status, GoalStatus.LOST, ending.text)
            self.assertTrue(ending.result.message, f"{action} ended {STATES[ending.status]} without a word")

        every_goal_ends()
        self.assertTrue(all(math.isfinite(v.linear.x) and math.isfinite(v.angular.z) for v in self.velocity.messages))
        self.assert_outcome("get_path", GetPathGoal(target_pose=pose_at(1.0)), "SUCCESS", "SUCCEEDED")

    # blindness

    def test_4_a_blind_robot_stands_and_says_why(self):
        causes = {
            "scan": (lambda: self.scanning.clear(), self.scanning.set),
            "odometry": (lambda: self.wheels.silent.add("odom"), lambda: self.wheels.silent.discard("odom")),
            "base_footprint": (lambda: self.wheels.silent.add("tf"), lambda: self.wheels.silent.discard("tf")),
            "'map'": (
                lambda: self.wheels.silent.add("localization"),
                lambda: self.wheels.silent.discard("localization"),
            ),
        }
        diagnostics = Listener("/diagnostics", DiagnosticArray, connected=True)

        def stands(message, words):
            told = [s.message for s in message.status if s.name.startswith("move_base_flex: ")]
            return any(text.startswith("the robot stands: ") and words in text for text in told)

        def why_a_drive_ends(words, blind, see):
            sent, feedback = self.drive()
            blind()
            try:
                diagnostics.wait_for(lambda m: stands(m, words), f"diagnostics that name {words}")
                ending = sent.wait(20.0)
            finally:
                see()
            self.assertIsNotNone(ending, f"waited 20 s for a drive without {words} to end, in vain")
            self.assertEqual(STATES[ending.status], "ABORTED")
            self.assertRegex(ending.result.message, r"\d\.\d+ s")
            wait_until(lambda: is_zero(self.velocity.last), f"a zero as the last velocity without {words}")
            wait_until(self.can_plan, "the robot to see again")
            return ending.result.message

        for words, (blind, see) in causes.items():
            said = []

            def names_it(words=words, blind=blind, see=see, said=said):
                said.append(why_a_drive_ends(words, blind, see))
                return words in said[-1]

            # all sensors are this process: one that had no core as the drive ended is missed, and named, instead
            wait_until(names_it, lambda said=said: f"a drive that ends for want of {words}, not by '{said[-1]}'")

    def can_plan(self):
        return self.end_of("get_path", GetPathGoal(target_pose=pose_at(1.0))).status == GoalStatus.SUCCEEDED

    # services

    def costmap(self):
        """The global costmap as it is published, in costs that are told apart there."""
        listener = Listener("move_base_flex/global_costmap/costmap", OccupancyGrid)
        message = wait_until(lambda: listener.last, "the global costmap")
        listener.close()
        info = message.info
        data = np.array(message.data, dtype=np.int16).reshape(info.height, info.width)
        costs = np.select([data == 100, data == 99, data == -1], [254, 253, 255], 1 * (data > 0)).astype(np.uint8)
        return CostGrid(
            Grid(round(info.resolution, 6), info.origin.position.x, info.origin.position.y, info.width, info.height),
            np.ascontiguousarray(costs),
            "map",
            BURGER,
            0.04,
            0.15,
        )

    def test_5_services_agree_with_the_published_costmap(self):
        services = {name: rospy.ServiceProxy(f"move_base_flex/{name}", kind) for name, kind in (
            ("check_point_cost", CheckPoint), ("check_pose_cost", CheckPose), ("check_path_cost", CheckPath))}
        services = {name: (service.wait_for_service(20.0), service)[1] for name, service in services.items()}
        paddings = (False, True) if hasattr(CheckPoseRequest(), "use_padded_fp") else (False,)  # 0.4.0 never pads
        costmap = self.costmap()
        rng = np.random.default_rng(4)
        for x, y, theta in rng.uniform((-3.2, -3.2, -3.0), (3.2, 3.2, 3.0), (40, 3)):
            pose = PoseStamped(header("map", 0.0), pose_to_message(Pose2D(x, y, theta)))
            point = services["check_point_cost"](PointStamped(pose.header, pose.pose.position), 2)
            self.assertEqual(point.state, int(inspection.check_point(costmap, x, y).state))
            for safety, padding in itertools.product((0.0, 0.2), paddings):
                outline = padded(BURGER, safety + (PADDING if padding else 0.0))
                request = CheckPoseRequest(pose=pose, costmap=2, safety_dist=safety)
                if padding:
                    request.use_padded_fp = True
                answer = services["check_pose_cost"](request)
                self.assertEqual(
                    answer.state, int(inspection.check_poses(costmap, np.array([(x, y, theta)]), outline)[0].state)
                )
        path = path_of(*np.arange(-2.0, 3.5, 0.05)).path
        poses = np.array([pose_from_message(stamped.pose) for stamped in path.poses])
        for return_on, skip, cells_only in ((0, 0, False), (2, 0, False), (2, 3, True), (4, 0, True)):
            answer = services["check_path_cost"](CheckPathRequest(
                path=path, costmap=2, return_on=return_on, skip_poses=skip, path_cells_only=cells_only))
            outline = inspection.POINT if cells_only else BURGER
            verdict, last = inspection.check_path(costmap, poses, outline, return_on=return_on, skip_poses=skip)
            self.assertEqual((answer.state, answer.last_checked), (int(verdict.state), last))
        current = services["check_pose_cost"](CheckPoseRequest(costmap=1, current_pose=True))
        self.assertEqual(current.state, 0)
        for wrong in (CheckPoseRequest(costmap=7), CheckPoseRequest(costmap=2, pose=pose_at(NAN)),
                      CheckPoseRequest(costmap=2, pose=pose_at(0.0, frame="atlantis"))):
            with self.assertRaises(rospy.ServiceException):
                services["check_pose_cost"](wrong)

    @unittest.skipUnless(hasattr(srv, "FindValidPose"), "mbf_msgs 0.4.0 has no such service")
    def test_5_a_valid_pose_is_found_where_the_published_costmap_has_one(self):
        service = rospy.ServiceProxy("move_base_flex/find_valid_pose", srv.FindValidPose)
        service.wait_for_service(20.0)
        costmap = self.costmap()
        rng = np.random.default_rng(4)
        for x, y, theta in rng.uniform((-3.2, -3.2, -3.0), (3.2, 3.2, 3.0), (40, 3)):
            pose = PoseStamped(header("map", 0.0), pose_to_message(Pose2D(x, y, theta)))
            found = service(srv.FindValidPoseRequest(pose=pose, costmap=2, dist_tolerance=0.5, angle_tolerance=0.4))
            expected = inspection.find_valid_pose(costmap, Pose2D(x, y, theta), BURGER, 0.5, 0.4)
            self.assertEqual(found.state, int(expected.verdict.state))
            if found.state < 2:
                self.assertLess(expected.pose.distance_to(pose_from_message(found.pose.pose)), 1e-6)

    def test_6_costmaps_update_clear_and_rest_when_asked(self):
        client = ReconfigureClient("move_base_flex", timeout=20.0)
        update, clear = (rospy.ServiceProxy(f"move_base_flex/{name}_costmaps", Empty) for name in ("update", "clear"))
        update()
        clear()
        client.update_configuration({"shutdown_costmaps": True, "shutdown_costmaps_delay": 0.2})
        footprint = Listener("move_base_flex/local_costmap/footprint", rospy.AnyMsg, connected=True)

        def rests():
            count = len(footprint.messages)
            threading.Event().wait(0.5)
            return len(footprint.messages) == count

        wait_until(rests, "resting costmaps")
        rested = len(footprint.messages)
        update()
        footprint.wait_for(lambda _message: True, "an update while costmaps rest", since=rested)
        wait_until(rests, "resting costmaps")
        self.assertEqual(self.end_of("get_path", GetPathGoal(target_pose=pose_at(1.0))).status, GoalStatus.SUCCEEDED)
        sent, _feedback = self.drive()
        sent.cancel()
        sent.wait(10.0)
        client.update_configuration({"shutdown_costmaps": False})
        wait_until(lambda: not rests(), "costmaps at work")
        client.close()


    # configuration

    def test_7_a_wrong_configuration_stops_the_start_and_says_what_is_wrong(self):
        navfn = {"name": "N", "type": "navfn/NavfnROS"}
        wrong = {
            "'N' twice": {"planners": [navfn, navfn]},
            "controller_frequency": {"controller_frequency": "fast"},
        }
        for words, parameters in wrong.items():
            name = f"wrong_{abs(hash(words))}"
            rospy.set_param(name, {**rospy.get_param("move_base_flex"), **parameters})
            node = subprocess.Popen(
                [program("move_base_flex"), f"__name:={name}"],
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                universal_newlines=True,
            )
            try:
                output = node.communicate(timeout=60.0)[0]
            finally:
                node.kill()
            self.assertEqual(node.returncode, 1, output)
            self.assertIn(words, output)
            self.assertNotIn("Traceback", output)


if __name__ == "__main__":
    rospy.init_node("move_base_flex_test")
    rostest.rosrun("mbf_relay", "server", MoveBaseFlexTest)
