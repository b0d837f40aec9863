"""The critics of place: how far a trajectory ends from the path and from the goal, with its centre and with its nose.

Source: base_local_planner's MapGridCostFunction as DWAPlanner uses it. Where that counts cells of a flooded grid, these
measure metres along and across the path itself, so scores change smoothly and a robot on a straight path does not hunt
between cells. As there, the cost is taken at a trajectory's end, and 1 m weighs as much as there.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.control.critics.critic import Critic, Scene
from mbf_relay.control.trajectories import Trajectories

LOOK_BACK = 0.3  # m of path behind the robot that still counts
MARGIN = 0.2  # m of path beyond what a trajectory can reach that still counts


class _OnPath(Critic):
    """Measures the ends of trajectories, moved forward by `_shift`, against the path."""

    def _shift(self, scene: Scene) -> float:
        """Return how far ahead of the robot's centre the measured point lies, in metres."""
        return 0.0

    def _measure(self, trajectories: Trajectories, scene: Scene) -> np.ndarray:
        """Return distance across and arc length along the path of each end, shape (N, 2)."""
        shift = self._shift(scene)
        held = scene.measured.get(shift)
        if held is not None and held[0] is trajectories:
            return held[1]
        ends = trajectories.ends
        points = ends[:, :2]
        if shift != 0.0:
            headings = ends[:, 2].copy()
            points = points + shift * np.column_stack((np.cos(headings), np.sin(headings)))
        reach = self.parameters.max_vel_trans * self.parameters.sim_time + abs(shift) + MARGIN
        arc = scene.path.robot_arc
        result = scene.path.project(points, arc - LOOK_BACK - abs(shift), arc + reach)
        scene.measured[shift] = trajectories, result
        return result


class PathDistance(_OnPath):
    """Charges the distance (m) from a trajectory's end to the path."""

    @property
    def scale(self) -> float:
        """path_distance_bias."""
        return self.parameters.path_distance_bias

    def score(self, trajectories: Trajectories, scene: Scene) -> np.ndarray:
        """Return metres."""
        return self._measure(trajectories, scene)[:, 0]


class GoalDistance(_OnPath):
    """Charges the distance (m) left along the path from a trajectory's end to the farthest in reach.

    A trajectory that stops at the goal with time to spare is taken to have come as much farther, so that of two that
    end at the goal the faster one is preferred.
    """

    @property
    def scale(self) -> float:
        """goal_distance_bias."""
        return self.parameters.goal_distance_bias

    def score(self, trajectories: Trajectories, scene: Scene) -> np.ndarray:
        """Return metres; relative to what is in reach, so that figures do not grow with the path."""
        farthest = scene.path.robot_arc + self.parameters.max_vel_trans * self.parameters.sim_time + abs(self._shift(scene))
        arcs = self._measure(trajectories, scene)[:, 1] + trajectories.spare
        return np.maximum(0.0, farthest + MARGIN - arcs)


class Alignment(PathDistance):
    """Charges the distance (m) from the nose at a trajectory's end to the path, so that the robot faces along it.

    Near the goal it falls silent, as in DWAPlanner: the nose would have to be beyond the path's end. It does so over as
    much path again, on which the noses of full trajectories are beyond the goal already, so that the turning does not
    jump where the robot comes that near.
    """

    def _shift(self, scene: Scene) -> float:
        return self.parameters.forward_point_distance * scene.focus

    def score(self, trajectories: Trajectories, scene: Scene) -> np.ndarray:
        """Return metres, less near the goal and in the end 0."""
        shift = self._shift(scene)
        silent = abs(shift) * math.sqrt(self.parameters.cheat_factor)
        beyond = _distance_to_goal(scene) - silent
        if shift == 0.0 or beyond <= 0.0:
            return np.zeros(len(trajectories))
        return super().score(trajectories, scene) * (min(1.0, beyond / silent) if silent > 0.0 else 1.0)


class GoalFront(GoalDistance):
    """Charges the distance (m) left along the path from the nose at a trajectory's end."""

    def _shift(self, scene: Scene) -> float:
        return self.parameters.forward_point_distance * scene.focus

    def score(self, trajectories: Trajectories, scene: Scene) -> np.ndarray:
        """Return metres."""
        if self.parameters.forward_point_distance == 0.0:
            return np.zeros(len(trajectories))
        return super().score(trajectories, scene)


def _distance_to_goal(scene: Scene) -> float:
    return scene.pose.distance_to(scene.path.goal)
