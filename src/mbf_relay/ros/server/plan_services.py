"""Plans as a service, without driving: `~make_plan` and each planner's own, such as `~NavfnROS/make_plan`.
"""

from __future__ import annotations

import threading
from typing import Callable

import rospy
from nav_msgs.srv import GetPlan, GetPlanRequest, GetPlanResponse

from mbf_relay.navigation.goals import PlanGoal, PlanResult
from mbf_relay.navigation.navigator import Navigator
from mbf_relay.outcomes import PlanningError
from mbf_relay.ros.common.conversions import path_to_message
from mbf_relay.ros.common.get_plan import turned
from mbf_relay.ros.server.messages import check_tolerance, framed_pose

INSTANCE = "make_plan"
"""The instances of the planners that serve here, so that neither goals nor their replanning wait for it."""

LOOK_PERIOD = 0.001
"""Wall time (s) between looks at a plan in the making."""


class PlanServices:
    """move_base's and its planners' services of one plan without a goal.

    A goal in an obstacle, in a closed room or in an unknown frame is answered by an empty plan as soon as that is
    known; exploration asks for hundreds. No recovery is tried, and nothing waits for patience.

    Args:
        navigator: Gives planners, costmaps and the robot.
        default: Gives the planner of `~make_plan`; empty for the first.
        rouse: Has the costmap of a side, "global" or "local", updated where it rests; raises ValueError where it
            cannot.
    """

    def __init__(
        self, navigator: Navigator, default: Callable[[], str] = lambda: "",
        rouse: Callable[[str], None] = lambda side: None,
    ) -> None:
        self._navigator, self._default, self._rouse = navigator, default, rouse
        self._one_at_a_time = threading.Lock()  # a planner is never called twice at once
        self._services = [rospy.Service("~make_plan", GetPlan, lambda request: self._answer(request, self._default()))]
        for name in navigator.planners.names:
            self.add(name)

    def add(self, name: str) -> None:
        """Offer a planner's own service."""
        self._navigator.planners.instance(name, INSTANCE)  # not on the first request, whose thread must not make one
        self._services.append(rospy.Service(f"~{name}/make_plan", GetPlan, lambda request: self._answer(request, name)))

    def _answer(self, request: GetPlanRequest, planner: str) -> GetPlanResponse:
        response = GetPlanResponse()
        response.plan.header.frame_id = self._navigator.parameters.global_frame
        response.plan.header.stamp = stamp = rospy.get_rostime()
        try:
            result = self._plan(_goal(request, planner))
        except (ValueError, PlanningError) as error:
            rospy.logwarn("make_plan found no path: %s", error)
            return response
        if result.path is None:
            rospy.logwarn("make_plan found no path: %s %s", result.outcome.name, result.message)
            return response
        response.plan = path_to_message(result.path, stamp)
        return response

    def _plan(self, goal: PlanGoal) -> PlanResult:
        """Return the result of planning once."""
        with self._one_at_a_time:
            execution = self._navigator.new_plan(goal, retry=False, instance=INSTANCE, announced=False)
            if not execution.task.done:
                self._rouse(execution.instance.costmap)
            while not execution.task.done:
                execution.update(rospy.get_time())
                if not execution.task.done:
                    threading.Event().wait(LOOK_PERIOD)
            return execution.task.ended_with()


def _goal(request: GetPlanRequest, planner: str) -> PlanGoal:
    """Return the goal of a request, whose empty start frame means where the robot is.

    Raises:
        InvalidMessage: A pose means nothing.
        PlanningError: The tolerance means nothing.
    """
    check_tolerance(request.tolerance)
    start = framed_pose(turned(request.start)) if request.start.header.frame_id else None
    return PlanGoal(framed_pose(turned(request.goal)), start, request.tolerance, planner)
