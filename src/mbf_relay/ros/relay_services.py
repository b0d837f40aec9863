"""move_base's services: ~make_plan and ~clear_costmaps."""

from __future__ import annotations

import threading
from typing import Any

import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, Quaternion
from mbf_msgs.msg import GetPathAction, GetPathGoal
from nav_msgs.srv import GetPlan, GetPlanRequest, GetPlanResponse
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse

from mbf_relay.ros.action_client import ActionClient
from mbf_relay.ros.outcome_codes import name_of

PLAN_SLOT = 255
"""The server's concurrency slot for ~make_plan: not the one its move_base plans in, so that both go on."""
PLAN_PATIENCE = 60.0
"""Wall time (s) a plan may take."""


class MakePlan:
    """~make_plan by the server's get_path; also while driving, which move_base itself refuses."""

    def __init__(self, parameters: Any, settings: Any) -> None:
        """Offer the service.

        Args:
            parameters: RelayParameters: the server and its timeouts.
            settings: MoveBaseSettings: `plugin_names()`, `values.make_plan_add_unreachable_goal`.
        """
        self._settings = settings
        self._client = ActionClient(f"{parameters.server}/get_path", GetPathAction, 5.0, parameters.silence_timeout)
        self._one_at_a_time = threading.Lock()
        self._service = rospy.Service("~make_plan", GetPlan, self._answer)

    def _answer(self, request: GetPlanRequest) -> GetPlanResponse:
        """Return the plan; an empty one where there is none."""
        with self._one_at_a_time:
            self._client.check()
            if not self._client.server_is_up:
                raise rospy.ServiceException(f"no plan: action server {self._client.name} is not there; is it running?")
            sent = self._client.send(path_goal(request, self._settings.plugin_names()[0]))
            ending = sent.wait(PLAN_PATIENCE)
        if ending is None:
            sent.cancel()
            raise rospy.ServiceException(f"no plan within {PLAN_PATIENCE:g} s")
        if ending.status == GoalStatus.LOST:
            raise rospy.ServiceException(f"no plan: {ending.text}")
        response = GetPlanResponse()
        if ending.status == GoalStatus.SUCCEEDED and ending.result is not None:
            response.plan = ending.result.path
            if self._settings.values.make_plan_add_unreachable_goal:
                append_goal(response.plan, request.goal)
        else:
            outcome = name_of(ending.result.outcome, type(ending.result)) if ending.result is not None else ""
            rospy.logwarn("make_plan found no path: %s %s", outcome, ending.text)
        return response


def path_goal(request: GetPlanRequest, planner: str) -> GetPathGoal:
    """Return the server's goal for a request.

    An empty start frame means the robot's pose. Planners of move_base ignore orientations, so that callers leave them
    zero; the server refuses those, and gets the identity instead.
    """
    goal = GetPathGoal(
        use_start_pose=bool(request.start.header.frame_id), start_pose=turned(request.start),
        target_pose=turned(request.goal), tolerance=request.tolerance, planner=planner,
    )
    if hasattr(goal, "concurrency_slot"):
        goal.concurrency_slot = PLAN_SLOT
    return goal


def turned(pose: PoseStamped) -> PoseStamped:
    """Return the pose, with the identity in place of an all-zero quaternion."""
    q = pose.pose.orientation
    if q.x or q.y or q.z or q.w:
        return pose
    result = PoseStamped(header=pose.header)
    result.pose.position, result.pose.orientation = pose.pose.position, Quaternion(0.0, 0.0, 0.0, 1.0)
    return result


def append_goal(plan: Any, goal: PoseStamped) -> None:
    """End a plan that stops short of the goal, within the tolerance asked for, with the goal itself."""
    if not plan.poses or plan.poses[-1].header.frame_id not in ("", goal.header.frame_id):
        return
    last, wanted = plan.poses[-1].pose.position, goal.pose.position
    if max(abs(last.x - wanted.x), abs(last.y - wanted.y)) > 1e-6:
        plan.poses.append(goal)


class ClearCostmaps:
    """~clear_costmaps by the server's."""

    def __init__(self, server: str) -> None:
        self._clear = rospy.ServiceProxy(f"{server}/clear_costmaps", Empty)
        self._service = rospy.Service("~clear_costmaps", Empty, self._answer)

    def _answer(self, _request: EmptyRequest) -> EmptyResponse:
        return self._clear()
