"""The server's costmap services: costs of points, poses and paths, a free pose nearby, updating, clearing."""

from __future__ import annotations

import time
from typing import Any, Callable, Mapping

import numpy as np
import rospy
from mbf_msgs import srv
from std_srvs.srv import Empty, EmptyRequest, EmptyResponse

from mbf_relay.costmap import inspection
from mbf_relay.costmap.costmap import Costmap
from mbf_relay.costmap.outline import padded
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.checks import check_finite
from mbf_relay.ros.common.conversions import pose_from_message, pose_stamped
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.ros.costmap.node import CostmapNode

TF_TIMEOUT = 0.5
"""Time (s) a request waits for a transform, as in mbf_costmap_nav."""

UPDATE_TIMEOUT = 2.0
"""Wall seconds a request waits for costmaps to be updated."""

SIDES = {1: "local", 2: "global"}
"""Costmap by the requests' constants LOCAL_COSTMAP and GLOBAL_COSTMAP, which all versions of mbf_msgs share."""


class CostmapServices:
    """Answers the services about costmaps, in the threads of rospy's services.

    They are `~check_point_cost`, `~check_pose_cost`, `~check_path_cost`, `~find_valid_pose`, `~update_costmaps` and
    `~clear_costmaps`.

    Args:
        nodes: "global" and "local".
        transforms: Where frames are looked up.
        robot_frame: Frame of the robot's base.
        wake: Resumes stopped costmaps before a request uses one; returns whether they had been stopped.
    """

    def __init__(
        self, nodes: Mapping[str, CostmapNode], transforms: Transforms, robot_frame: str, wake: Callable[[], bool]
    ) -> None:
        self._nodes, self._transforms, self._robot_frame, self._wake = nodes, transforms, robot_frame, wake
        self._serve("check_point_cost", srv.CheckPoint, self._check_point)
        self._serve("check_pose_cost", srv.CheckPose, self._check_pose)
        self._serve("check_path_cost", srv.CheckPath, self._check_path)
        self._serve("update_costmaps", Empty, self._update)
        self._serve("clear_costmaps", Empty, self._clear)
        if hasattr(srv, "FindValidPose"):  # not in mbf_msgs 0.4.0
            self._serve("find_valid_pose", srv.FindValidPose, self._find_valid_pose)

    def _serve(self, name: str, service_type: Any, answer: Callable[[Any], Any]) -> None:
        def handle(request: Any) -> Any:
            try:
                return answer(request)
            except (ValueError, TransformError) as error:
                rospy.logwarn("%s: %s", name, error)
                raise rospy.ServiceException(str(error)) from error

        rospy.Service(f"~{name}", service_type, handle)

    def _check_point(self, request: Any) -> Any:
        costmap = self._costmap(request.costmap)
        point = request.point.point
        check_finite(x=point.x, y=point.y)
        x, y = self._to_costmap(costmap, request.point.header).transform_points(np.array([[point.x, point.y]]))[0]
        verdict = inspection.check_point(costmap.snapshot(), x, y)
        return srv.CheckPointResponse(state=int(verdict.state), cost=_cost(verdict.cost))

    def _check_pose(self, request: Any) -> Any:
        costmap = self._costmap(request.costmap)
        outline = _outline(costmap, request)
        pose = self._pose(costmap, request)
        verdict = inspection.check_poses(costmap.snapshot(), np.array([pose]), outline, _multipliers(request))[0]
        return srv.CheckPoseResponse(state=int(verdict.state), cost=_cost(verdict.cost))

    def _check_path(self, request: Any) -> Any:
        costmap = self._costmap(request.costmap)
        outline = inspection.POINT if request.path_cells_only else _outline(costmap, request)
        poses = np.array([
            self._to_costmap(costmap, stamped.header if stamped.header.frame_id else request.path.header).compose(
                pose_from_message(stamped.pose))
            for stamped in request.path.poses
        ]).reshape(-1, 3)
        verdict, last = inspection.check_path(
            costmap.snapshot(), poses, outline, _multipliers(request), request.return_on, request.skip_poses
        )
        return srv.CheckPathResponse(last_checked=last, state=int(verdict.state), cost=_cost(verdict.cost))

    def _find_valid_pose(self, request: Any) -> Any:
        costmap = self._costmap(request.costmap)
        tolerances = {"dist_tolerance": request.dist_tolerance, "angle_tolerance": request.angle_tolerance}
        check_finite(**tolerances)
        for name, value in tolerances.items():
            if value < 0.0:
                raise ValueError(f"{name} is {value}; it must be 0 or above")
        outline = _outline(costmap, request)
        found = inspection.find_valid_pose(
            costmap.snapshot(), self._pose(costmap, request), outline, request.dist_tolerance, request.angle_tolerance
        )
        response = srv.FindValidPoseResponse(state=int(found.verdict.state), cost=_cost(found.verdict.cost))
        response.pose = pose_stamped(found.pose, costmap.frame, rospy.get_rostime())
        return response

    def rouse(self, side: str) -> None:
        """Resume a stopped costmap and wait for its update; raise ValueError after UPDATE_TIMEOUT."""
        if self._wake():
            self._await_updates(side)

    def _update(self, _request: EmptyRequest) -> EmptyResponse:
        self._wake()
        self._await_updates(*self._nodes)
        return EmptyResponse()

    def _await_updates(self, *sides: str) -> None:
        """Request updates of costmaps and wait for them; raise ValueError after UPDATE_TIMEOUT."""
        asked = {side: self._nodes[side].costmap.updates for side in sides}
        for side in sides:
            self._nodes[side].resume()
        end = time.monotonic() + UPDATE_TIMEOUT
        for side in sides:
            node = self._nodes[side]
            while node.costmap.updates == asked[side]:
                if time.monotonic() > end:
                    reason = node.costmap.stale_reason(rospy.get_time())
                    raise ValueError(f"the {side} costmap did not update within {UPDATE_TIMEOUT} s: {reason}")
                time.sleep(0.01)

    def _clear(self, _request: EmptyRequest) -> EmptyResponse:
        for node in self._nodes.values():
            node.costmap.clear()
        return EmptyResponse()

    def _costmap(self, number: int) -> Costmap:
        """Return the requested costmap, up to date; raise ValueError where there is no such one, or it is stale."""
        if number not in SIDES:
            raise ValueError(f"costmap is {number}; it must be LOCAL_COSTMAP (1) or GLOBAL_COSTMAP (2)")
        side = SIDES[number]
        costmap = self._nodes[side].costmap
        self.rouse(side)
        if costmap.planning_trouble(rospy.get_time()) is not None:
            self._await_updates(side)
        trouble = costmap.planning_trouble(rospy.get_time())
        if trouble is not None:
            raise ValueError(trouble.message)
        return costmap

    def _pose(self, costmap: Costmap, request: Any) -> Pose2D:
        if request.current_pose:
            return self._transforms.lookup(costmap.frame, self._robot_frame, timeout=TF_TIMEOUT)
        return self._to_costmap(costmap, request.pose.header).compose(pose_from_message(request.pose.pose))

    def _to_costmap(self, costmap: Costmap, header: Any) -> Pose2D:
        if header.frame_id.lstrip("/") == costmap.frame:
            return IDENTITY
        return self._transforms.lookup(costmap.frame, header.frame_id, timeout=TF_TIMEOUT)


def _outline(costmap: Costmap, request: Any) -> np.ndarray:
    check_finite(safety_dist=request.safety_dist)
    return padded(
        costmap.footprint if getattr(request, "use_padded_fp", False) else costmap.outline, request.safety_dist
    )


def _multipliers(request: Any) -> inspection.Multipliers:
    values = (request.lethal_cost_mult, request.inscrib_cost_mult, request.unknown_cost_mult)
    check_finite(lethal_cost_mult=values[0], inscrib_cost_mult=values[1], unknown_cost_mult=values[2])
    return inspection.Multipliers(*values)


def _cost(cost: float) -> int:
    """Return a cost clamped to uint32, the type in the responses."""
    return int(min(max(cost, 0.0), 2 ** 32 - 1))

