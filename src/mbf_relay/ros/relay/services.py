"""move_base's services, ~make_plan and ~clear_costmaps, and ~pause and ~resume, which its users asked for."""

from __future__ import annotations

import threading
import time
from functools import partial
from typing import Any, Callable, Optional

import rosgraph
import rospy
from actionlib_msgs.msg import GoalStatus
from mbf_msgs.msg import GetPathAction, GetPathGoal
from nav_msgs.srv import GetPlan, GetPlanRequest, GetPlanResponse
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse, Trigger, TriggerResponse

from mbf_relay.ros.common.actions.action_client import ActionClient
from mbf_relay.ros.common.actions.server_watch import GONE, MUTE, ask_node
from mbf_relay.ros.common.get_plan import append_goal, with_orientation
from mbf_relay.ros.common.outcome_codes import name_of
from mbf_relay.ros.relay.topics import PLANNER

PLAN_SLOT = 255
"""The server's concurrency slot for ~make_plan, so that it replaces no plan of other clients, which use slot 0."""
CONNECTING = 1.0
"""Wall time (s) to wait for a server that is not connected yet, as right after its start."""
PLAN_PATIENCE = 60.0
"""Longest wall time (s) for a plan."""
PLANNERS = ("NavfnROS", "GlobalPlanner")
"""Planners of move_base with a service of their own, such as ~NavfnROS/make_plan."""
LOOK_EVERY = 0.1
"""Wall time (s) between two checks of the server while it plans."""


class MakePlan:
    """~make_plan and the planners' own, by the server's service of that name if it has one, else by its get_path.

    Unlike move_base's they also work while the robot drives. The service is preferred, since it tries once: get_path
    retries until its patience ends, for a goal in an obstacle too.
    """

    def __init__(self, parameters: Any, settings: Any) -> None:
        """Offer the services.

        Args:
            parameters: RelayParameters: the server and its timeouts.
            settings: MoveBaseSettings: `plugin_names()`, `server_name()`, `values.make_plan_add_unreachable_goal`.
        """
        self._settings, self._server = settings, parameters.server
        # also used with the service: it can tell a server that hangs from one that is slow
        silence = parameters.silence_timeout
        self._client = ActionClient(
            f"{parameters.server}/get_path", GetPathAction, 2.0 * parameters.service_timeout, silence
        )
        self._one_at_a_time = threading.Lock()
        rospy.Service("~make_plan", GetPlan, self._answer)
        for name in PLANNERS:
            rospy.Service(f"~{name}/make_plan", GetPlan, partial(self._answer_as, name))

    def _answer(self, request: GetPlanRequest) -> GetPlanResponse:
        """Return the plan of the chosen planner; an empty one where there is none."""
        response = self._plan(request, lambda: str(self._settings.plugin_names()[0]))
        if self._settings.values.make_plan_add_unreachable_goal:
            append_goal(response.plan, request.goal)
        return response

    def _answer_as(self, planner: str, request: GetPlanRequest) -> GetPlanResponse:
        """Return the plan of one of PLANNERS, as its own service does; an empty one where there is none."""
        return self._plan(request, lambda: str(self._settings.server_name(PLANNER, planner)))

    def _plan(self, request: GetPlanRequest, planner_name: Callable[[], str]) -> GetPlanResponse:
        """Return the plan of a planner, by its name at the server once that is there, empty for the first."""
        with self._one_at_a_time:
            if not self._client.wait_for_server(CONNECTING):
                raise rospy.ServiceException(f"no plan: {self._client.why_down}")
            planner = planner_name()
            owner = f"{self._server}/{planner}" if planner else self._server
            service = str(rospy.resolve_name(f"{owner}/make_plan"))
            if _is_served(service):
                return self._answer_at_once(request, rospy.ServiceProxy(service, GetPlan))
            sent = self._client.send(path_goal(request, planner))
            ending = sent.wait(PLAN_PATIENCE)
        if ending is None:
            sent.cancel()
            raise rospy.ServiceException(f"no plan within {PLAN_PATIENCE:g} s")
        if ending.status == GoalStatus.LOST:
            raise rospy.ServiceException(f"no plan: {ending.text}")
        response = GetPlanResponse()
        if ending.status == GoalStatus.SUCCEEDED and ending.result is not None:
            response.plan = ending.result.path
        else:
            outcome = name_of(ending.result.outcome, type(ending.result)) if ending.result is not None else ""
            rospy.logwarn("make_plan found no path: %s %s", outcome, ending.text)
        return response

    def _answer_at_once(self, request: GetPlanRequest, service: rospy.ServiceProxy) -> GetPlanResponse:
        call, deadline = ServiceCall(service, request), time.monotonic() + PLAN_PATIENCE
        while call.is_alive() and time.monotonic() < deadline:
            self._client.check()
            if not self._client.server_is_up:
                raise rospy.ServiceException(f"no plan: {self._client.why_down}")
            call.join(LOOK_EVERY)
        if call.is_alive():
            raise rospy.ServiceException(f"no plan within {PLAN_PATIENCE:g} s")
        if call.error is not None:
            raise rospy.ServiceException(f"no plan: {call.error}")
        response: GetPlanResponse = call.response
        return response


def _is_served(service: str) -> bool:
    """Return whether anybody offers a service; the C++ server has no make_plan."""
    try:
        return bool(rosgraph.Master(rospy.get_name()).lookupService(service))
    except (OSError, rosgraph.MasterException):
        return False


def path_goal(request: GetPlanRequest, planner: str) -> GetPathGoal:
    """Return the server's get_path goal for a request.

    An empty start frame means the robot's pose. Quaternions of zeros, which move_base's planners ignore and the server
    refuses, are replaced by the identity.
    """
    goal = GetPathGoal(
        use_start_pose=bool(request.start.header.frame_id), start_pose=with_orientation(request.start),
        target_pose=with_orientation(request.goal), tolerance=request.tolerance, planner=planner,
    )
    if hasattr(goal, "concurrency_slot"):
        goal.concurrency_slot = PLAN_SLOT
    return goal


class ClearCostmaps:
    """~clear_costmaps by the server's service, with a timeout of `patience` wall seconds."""

    def __init__(self, server: str, patience: float) -> None:
        self._node, self._patience = rospy.resolve_name(server), patience
        self._clear = rospy.ServiceProxy(f"{server}/clear_costmaps", Empty)
        self._lock = threading.Lock()  # guards `_hanging`
        self._hanging: Optional[ServiceCall] = None
        rospy.Service("~clear_costmaps", Empty, self._answer)

    def _answer(self, _request: EmptyRequest) -> EmptyResponse:
        """Call the server's service, or wait for a call that has not returned since an earlier timeout."""
        with self._lock:
            call = self._hanging if self._hanging is not None and self._hanging.is_alive() else ServiceCall(self._clear)
        call.join(self._patience)
        if call.is_alive():
            with self._lock:
                self._hanging = call
            raise rospy.ServiceException(no_answer(self._clear.resolved_name, self._node, self._patience))
        if call.error is not None:
            raise rospy.ServiceException(f"service {self._clear.resolved_name}: {call.error}")
        return call.response


class PauseByServer:
    """~pause and ~resume by the server's services; the C++ server has none, and then they fail with a text."""

    def __init__(self, server: str, patience: float) -> None:
        self._node, self._patience = rospy.resolve_name(server), patience
        for name in ("pause", "resume"):
            rospy.Service(f"~{name}", Trigger, lambda _request, name=name: self._answer(name))

    def _answer(self, name: str) -> TriggerResponse:
        call = ServiceCall(rospy.ServiceProxy(f"{self._node}/{name}", Trigger))
        call.join(self._patience)
        if call.is_alive():
            return TriggerResponse(False, no_answer(f"{self._node}/{name}", self._node, self._patience))
        return call.response or TriggerResponse(False, f"service {self._node}/{name}: {call.error}")


class ServiceCall(threading.Thread):
    """A service call in a thread of its own, since rospy's calls have no timeout; `join` has one.

    Attributes:
        response: The response, None before.
        error: The exception, None where there was none.
    """

    def __init__(self, service: rospy.ServiceProxy, *arguments: Any) -> None:
        super().__init__(name=f"call of {service.resolved_name}", daemon=True)
        self._call, self._arguments = service, arguments
        self.response: Any = None
        self.error: Optional[Exception] = None
        self.start()

    def run(self) -> None:
        """Call it."""
        try:
            self.response = self._call(*self._arguments)
        except Exception as error:  # reported by whoever joins
            self.error = error


def no_answer(service: str, node: str, patience: float) -> str:
    """Return the error for a service that did not answer in time, with the state of its node."""
    states = {MUTE: "hangs: it answers nobody", GONE: "does not exist any more"}
    state = states.get(ask_node(node), "is there, but busy")
    return f"service {service} did not answer within {patience:g} s; its node {node} {state}"
