"""Regulated pure pursuit: steer for a point ahead on the path, as fast as curvature, obstacles and goal allow."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Optional

import numpy as np

from mbf_relay.control.braking import arc, stopping_time
from mbf_relay.control.cycle import ControlCycle
from mbf_relay.control.follower import PathFollower
from mbf_relay.control.follower_parameters import FollowerParameters
from mbf_relay.control.report import CycleReport
from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.parameters import parameter

NEARER = (1.0, 0.75, 0.5, 0.35)  # shares of the lookahead distance tried, in this order
SLOWER = (1.0, 0.6, 0.3)  # shares of the regulated speed tried, in this order
TIGHTEST = 0.1  # robot's widths: least radius of an arc
STANDS = 0.01  # share of desired_linear_vel up to which no arc is driven, as with no part of the path in sight


@dataclass(frozen=True)
class PurePursuitParameters(FollowerParameters):
    """Parameters of RegulatedPurePursuit, by the names of Nav2's controller of that name; lengths suit a small robot.
    """

    desired_linear_vel: float = parameter(0.5, "speed on a straight path without obstacles", "m/s", above=0.0)
    lookahead_dist: float = parameter(
        0.3, "distance along the path to the point steered for, if it does not depend on speed", "m", above=0.0)
    use_velocity_scaled_lookahead_dist: bool = parameter(
        False, "look ahead by lookahead_time instead of lookahead_dist, between min_lookahead_dist and "
        "max_lookahead_dist")
    lookahead_time: float = parameter(
        1.5, "the lookahead distance is the speed times this, if it depends on speed", "s", above=0.0)
    min_lookahead_dist: float = parameter(0.2, "shortest lookahead distance, if it depends on speed", "m", above=0.0)
    max_lookahead_dist: float = parameter(0.9, "longest lookahead distance, if it depends on speed", "m", above=0.0)
    use_regulated_linear_velocity_scaling: bool = parameter(True, "slow down in curves")
    regulated_linear_scaling_min_radius: float = parameter(
        0.3, "radius of a curve below which the robot slows down", "m", above=0.0)
    regulated_linear_scaling_min_speed: float = parameter(
        0.1, "lowest speed to which curves and obstacles slow the robot", "m/s", minimum=0.0)
    use_cost_regulated_linear_velocity_scaling: bool = parameter(True, "slow down near obstacles")
    cost_scaling_dist: float = parameter(
        0.15, "distance to an obstacle below which the robot slows down", "m", above=0.0)
    cost_scaling_gain: float = parameter(
        1.0, "factor on the speed near obstacles; 1 makes it proportional to the distance, less is slower", above=0.0,
        maximum=1.0)
    approach_velocity_scaling_dist: float = parameter(
        0.1, "distance to the goal below which the robot slows down", "m", minimum=0.0)
    min_approach_linear_velocity: float = parameter(0.05, "lowest speed on the approach to the goal", "m/s", above=0.0)
    max_allowed_time_to_collision_up_to_carrot: float = parameter(
        1.0, "time for which the arc to the lookahead point must be free of collision", "s", minimum=0.0)
    use_rotate_to_heading: bool = parameter(True, "turn on the spot first if the path starts in another direction")
    rotate_to_heading_min_angle: float = parameter(
        0.785, "angle to the path above which the robot turns on the spot", "rad", above=0.0)

    def check(self) -> None:
        """Refuse limits that contradict each other."""
        super().check()
        if self.min_lookahead_dist > self.max_lookahead_dist:
            raise ValueError(
                f"parameter min_lookahead_dist is {self.min_lookahead_dist}; it must be at most max_lookahead_dist, "
                f"which is {self.max_lookahead_dist}"
            )


class RegulatedPurePursuit(PathFollower):
    """Follows the path by arcs through a point ahead on it.

    Source: Macenski, Singh, Martin, Gines, "Regulated Pure Pursuit for Robot Path Tracking" (2023), equations 2 to 6.
    Beyond the paper: where the arc to the lookahead point is not free, nearer points and lower speeds are tried, so
    that it passes gaps whose corners the arc would cut.

    Attributes:
        carrot: The lookahead point (2,) of the last arc driven, in the costmap's frame; None before.
    """

    Parameters = PurePursuitParameters
    parameters: PurePursuitParameters

    def __init__(self, name: str, parameters: PurePursuitParameters) -> None:
        super().__init__(name, parameters)
        self.carrot: Optional[np.ndarray] = None
        self._arc = np.zeros((0, 3))

    @property
    def lookahead(self) -> float:
        """Lookahead distance (m) at the last commanded speed."""
        p = self.parameters
        if not p.use_velocity_scaled_lookahead_dist:
            return p.lookahead_dist
        return min(p.max_lookahead_dist, max(p.min_lookahead_dist, abs(self.command.x) * p.lookahead_time))

    @property
    def turn_to_path_angle(self) -> float:
        """rotate_to_heading_min_angle; infinite without use_rotate_to_heading."""
        p = self.parameters
        return p.rotate_to_heading_min_angle if p.use_rotate_to_heading else math.inf

    def drive(self, cycle: ControlCycle) -> Twist2D:
        """Return the fastest free arc to the farthest lookahead point, or a turn to the path where no arc is free."""
        for share in NEARER:
            carrot = self._carrot(cycle, share * cycle.horizon_scale * self.lookahead)
            curvature = _curvature_to(cycle.state.pose, carrot, TIGHTEST * cycle.state.costmap.width)
            speed = self._regulated_speed(cycle, curvature)
            for slower in SLOWER:
                command = self._command_for(cycle, slower * speed, curvature)
                leads = command != STOP and speed > STANDS * self.parameters.desired_linear_vel
                if not leads:
                    continue
                self._arc = self._arc_of(cycle, command)
                if cycle.checker.free_steps(self._arc, cycle.state.pose) == len(self._arc):
                    self.carrot = carrot
                    return command
        turn = self.turn_to_path(cycle, 0.0)
        if turn is not None:
            return turn
        raise self.nothing_left(
            cycle, "no arc to the path ahead is free" if cycle.turn > 0.0 else "its path is not straight ahead of it, "
            "and its top rotational speed is 0")

    def report(self, cycle: ControlCycle, drove: bool) -> CycleReport:
        """Return the report with the arc that was checked for the command."""
        plain = super().report(cycle, drove)
        if not drove or not self.command.speed():
            return plain
        return dataclasses.replace(plain, trajectory=self._arc)

    def _carrot(self, cycle: ControlCycle, distance: float) -> np.ndarray:
        """Return the first point (2,) ahead on the path or its extension at least `distance` (m) from the robot."""
        path, pose = cycle.path, cycle.state.pose
        ahead = path.arcs >= path.robot_arc
        points = path.points[ahead]
        far = np.hypot(points[:, 0] - pose.x, points[:, 1] - pose.y) >= distance
        carrot: np.ndarray = points[int(np.argmax(far))] if far.any() else path.points[-1]
        return carrot

    def _regulated_speed(self, cycle: ControlCycle, curvature: float) -> float:
        p = self.parameters
        speed = p.desired_linear_vel
        if p.use_regulated_linear_velocity_scaling and abs(curvature) * p.regulated_linear_scaling_min_radius > 1.0:
            speed /= abs(curvature) * p.regulated_linear_scaling_min_radius
        if p.use_cost_regulated_linear_velocity_scaling:
            pose = cycle.state.pose
            clearance = cycle.checker.clearance_at(pose.x, pose.y) - cycle.state.costmap.inscribed_radius
            if clearance < p.cost_scaling_dist:
                speed *= p.cost_scaling_gain * max(0.0, clearance) / p.cost_scaling_dist
        speed = min(p.desired_linear_vel, max(speed, p.regulated_linear_scaling_min_speed))
        remaining = cycle.path.remaining
        if remaining < p.approach_velocity_scaling_dist:
            speed = min(speed, max(
                p.min_approach_linear_velocity, p.desired_linear_vel * remaining / p.approach_velocity_scaling_dist))
        return min(speed, cycle.speed)

    @staticmethod
    def _command_for(cycle: ControlCycle, speed: float, curvature: float) -> Twist2D:
        """Return the reachable velocity for an arc (m/s, 1/m); slower where it would exceed the rotational limit."""
        turn = speed * curvature
        if abs(turn) > cycle.turn:
            speed, turn = speed * cycle.turn / abs(turn), math.copysign(cycle.turn, turn)
        return cycle.window.clip(Twist2D(speed, 0.0, turn))

    def _arc_of(self, cycle: ControlCycle, command: Twist2D) -> np.ndarray:
        """Return the arc (N, 3) that must be free: for the time asked by the parameters, and for braking in any case.
        """
        p, state = self.parameters, cycle.state
        to_goal = cycle.path.remaining / max(command.speed(), 1e-3)
        held = min(p.max_allowed_time_to_collision_up_to_carrot, to_goal)
        return arc(cycle.checker, state, command, max(stopping_time(p, command, state.period), held))


def _curvature_to(pose: Pose2D, point: np.ndarray, tightest: float) -> float:
    """Return the curvature (1/m) of the arc from a pose through a point (2,), with a least radius (m)."""
    ahead = Pose2D(float(point[0]), float(point[1]), 0.0).relative_to(pose)
    squared = max(ahead.x * ahead.x + ahead.y * ahead.y, 0.25 * tightest * tightest)
    return min(1.0 / tightest, max(-1.0 / tightest, 2.0 * ahead.y / squared))
