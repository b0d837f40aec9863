"""Services that plan without driving: `~make_plan`, and one per planner, such as `~NavfnROS/make_plan`."""

from __future__ import annotations

import threading
import time
from typing import Callable

import rospy
from nav_msgs.srv import GetPlan, GetPlanRequest, GetPlanResponse

from mbf_relay.navigation.goals import PlanGoal, PlanResult
from mbf_relay.navigation.navigator import Navigator
from mbf_relay.outcomes import PlanningError
from mbf_relay.ros.common.conversions import path_to_message
from mbf_relay.ros.common.get_plan import with_orientation
from mbf_relay.ros.server.messages import check_tolerance, framed_pose

INSTANCE = "make_plan"
"""Key of the planner instances used here, so that goals and replans need not wait for a service's plan."""

LOOK_PERIOD = 0.001
"""Wall time (s) between two checks whether a plan is done."""


class PlanServices:
    """Services of move_base and its planners that make one plan.

    There are no retries and no recoveries: a blocked or unreachable goal, or an unknown frame, is answered by an empty
    plan at once, as exploration nodes may ask for hundreds of plans.

    Args:
        navigator: Gives planners, costmaps and the robot.
        default: Returns the name of the planner for `~make_plan`; empty for the first.
        rouse: Updates a stopped costmap, "global" or "local"; raises ValueError where that fails.
    """

    def __init__(
        self, navigator: Navigator, default: Callable[[], str] = lambda: "",
        rouse: Callable[[str], None] = lambda side: None,
    ) -> None:
        self._navigator, self._default, self._rouse = navigator, default, rouse
        self._one_at_a_time = threading.Lock()  # a planner is never called twice at once
        rospy.Service("~make_plan", GetPlan, lambda request: self._answer(request, self._default()))
        for name in navigator.planners.names:
            self.add(name)

    def add(self, name: str) -> None:
        """Offer a planner's own service."""
        self._navigator.planners.instance(name, INSTANCE)  # made here, since a service's thread must not make plugins
        rospy.Service(f"~{name}/make_plan", GetPlan, lambda request: self._answer(request, name))

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
                    time.sleep(LOOK_PERIOD)
            return execution.task.ended_with()


def _goal(request: GetPlanRequest, planner: str) -> PlanGoal:
    """Return the goal of a request; an empty start frame means the robot's pose.

    Raises:
        InvalidMessage: A pose is invalid.
        PlanningError: The tolerance is negative or not finite.
    """
    check_tolerance(request.tolerance)
    start = framed_pose(with_orientation(request.start)) if request.start.header.frame_id else None
    return PlanGoal(framed_pose(with_orientation(request.goal)), start, request.tolerance, planner)
