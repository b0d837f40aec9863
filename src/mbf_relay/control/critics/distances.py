"""Critics of a trajectory's end: its distance from the path and from the goal.

Both exist for the robot's centre and for its forward point.

Source: base_local_planner's MapGridCostFunction as DWAPlanner uses it. Where that counts cells of a wavefront, these
measure metres along and across the path itself, so scores change smoothly and a robot on a straight path does not hunt
between cells. As there, the cost is taken at a trajectory's end, and 1 m weighs as much as there.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.control import path_kernels
from mbf_relay.control.critics.critic import Critic, CriticData
from mbf_relay.control.trajectories import Trajectories
from mbf_relay.geometry import normalize_angles

LOOK_BACK = 1.3  # robot's widths of path behind the robot on which ends are projected
MARGIN = 0.9  # robot's widths of path beyond a trajectory's reach on which ends are projected
CUT = math.sqrt(2.0)  # most progress along the path per metre driven: cutting a right-angled corner


class _OnPath(Critic):
    """Projects the ends of trajectories, moved forward by `_shift`, on the path."""

    judges_place = True

    def _shift(self, data: CriticData) -> float:
        """Return how far ahead of the robot's centre the measured point lies, in metres."""
        return 0.0

    def _measure(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return distance from and arc length (m) along the path of each end, shape (N, 2)."""
        return self._measure_at(self._shift(data), trajectories, data)

    def _measure_at(self, shift: float, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return `_measure` for the points `shift` metres ahead of the ends."""
        held = data.measured.get(shift)
        if held is not None and held[0] is trajectories:
            return held[1]
        points = np.empty((len(trajectories), 2))
        path_kernels.look_ahead(trajectories.ends, shift, points)
        reach = self.parameters.max_vel_trans * self.parameters.sim_time + abs(shift) + MARGIN * data.width
        arc = data.path.robot_arc
        result = data.path.project(points, arc - LOOK_BACK * data.width - abs(shift), arc + reach)
        np.minimum(result[:, 1], self._farthest(trajectories, data, shift), out=result[:, 1])
        data.measured[shift] = trajectories, result
        return result

    def _farthest(self, trajectories: Trajectories, data: CriticData, shift: float) -> np.ndarray:
        """Return the largest arc length (m) each end can be at, shape (N,), by the distance driven and cut corners.

        Where a path folds back, a part much farther along lies beside the robot. Being near to that is no progress: the
        robot would stand where its forward point is near both parts, since driving on means going back on the other.
        """
        if shift != 0.0:
            return self._measure_at(0.0, trajectories, data)[:, 1] + (abs(shift) + MARGIN * data.width)
        return data.path.robot_arc + MARGIN * data.width + CUT * trajectories.driven


class PathDistance(_OnPath):
    """Charges the distance (m) from a trajectory's end to the path."""

    @property
    def scale(self) -> float:
        """path_distance_bias."""
        return self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return metres."""
        return self._measure(trajectories, data)[:, 0]


class GoalDistance(_OnPath):
    """Charges the distance (m) left along the path from a trajectory's end to the farthest in reach.

    A trajectory that stops at the goal with time to spare is taken to have come as much farther, so that of two that
    end at the goal the faster one is preferred.
    """

    @property
    def scale(self) -> float:
        """goal_distance_bias."""
        return self.parameters.goal_distance_bias

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return metres, relative to what is in reach, so that scores do not grow with the path's length."""
        farthest = (
            data.path.robot_arc + self.parameters.max_vel_trans * self.parameters.sim_time + abs(self._shift(data))
        )
        arcs = self._measure(trajectories, data)[:, 1] + trajectories.spare
        left: np.ndarray = np.maximum(0.0, farthest + MARGIN * data.width - arcs)
        return left


class Alignment(PathDistance):
    """Charges the distance (m) from the forward point at a trajectory's end to the path: the robot faces along it.

    Near the goal, where the forward point lies beyond the path's end, its weight is 0, as in DWAPlanner. It falls to 0
    linearly from twice that distance on, so that the rotational velocity does not jump.
    """

    yields_where_held = True

    def _shift(self, data: CriticData) -> float:
        return self.parameters.forward_point_distance * data.horizon_scale

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return metres, scaled down near the goal."""
        shift = self._shift(data)
        silent = abs(shift) * math.sqrt(self.parameters.cheat_factor)
        beyond = _distance_to_goal(data) - silent
        if shift == 0.0 or beyond <= 0.0:
            return np.zeros(len(trajectories))
        return super().score(trajectories, data) * (min(1.0, beyond / silent) if silent > 0.0 else 1.0)


class GoalFront(GoalDistance):
    """Charges the distance (m) left along the path from the forward point at a trajectory's end."""

    yields_where_held = True

    def _shift(self, data: CriticData) -> float:
        return self.parameters.forward_point_distance * data.horizon_scale

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return metres."""
        if self.parameters.forward_point_distance == 0.0:
            return np.zeros(len(trajectories))
        return super().score(trajectories, data)


def _distance_to_goal(data: CriticData) -> float:
    return data.pose.distance_to(data.path.goal)


class Heading(Critic):
    """Charges the angle (rad) between a trajectory's heading and the farthest point of the path in sight.

    Source: base_local_planner's heading scoring, which looks from each trajectory for that point; here it is the one
    the robot sees from where it is.
    """

    @property
    def scale(self) -> float:
        """heading_scale."""
        return self.parameters.heading_scale

    def score(self, trajectories: Trajectories, data: CriticData) -> np.ndarray:
        """Return radians."""
        path = data.path
        ahead = path.points[(path.arcs > path.robot_arc) & (path.arcs <= path.goal_arc)]
        seen = np.flatnonzero(data.checker.in_sight(data.pose, ahead)) if len(ahead) else ahead
        if len(seen) == 0:
            return np.zeros(len(trajectories))
        share = min(1.0, self.parameters.heading_time / self.parameters.sim_time)
        steps = np.maximum((trajectories.counts * share).astype(int) - 1, 0)
        poses = trajectories.poses[np.arange(len(trajectories)), steps]
        target = ahead[seen[-1]]
        bearings = np.arctan2(target[1] - poses[:, 1], target[0] - poses[:, 0])
        errors: np.ndarray = np.abs(normalize_angles(bearings - poses[:, 2]))
        return errors
