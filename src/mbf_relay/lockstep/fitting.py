"""Derives the nodes' parameters for another robot than the one they were tuned for.

Lengths scale with the robot's size and cells with its width; speeds and accelerations are set to the robot's limits and
ranges to its lidar's. Weights of costs and critics stay.
"""

from __future__ import annotations

import copy
import math
from typing import Any, Dict, List, Mapping

import numpy as np

from mbf_relay.costmap.outline import parse_footprint
from mbf_relay.lockstep.settings import Settings
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.robot import CAR, OMNIDIRECTIONAL, RobotModel

SERVER = "move_base_flex"
"""Name of the node's parameter file."""
STRAIGHT = 0.74
"""Share of the wheels' acceleration that is used for acc_lim_x; the rest is left for turning at the same time.

With full limits for both, an outer wheel cannot follow, and the robot goes on turning after it is told not to.
"""
LOOK_AHEAD = 0.5
"""Least lookahead distance of a controller, as time (s) at top speed."""
CARS_PROGRESS = 0.5 * math.pi
"""oscillation_angle (rad) of a car: it takes long to turn round in several moves, during which it stays in one place.
"""


def fitted(settings: Settings, robot: RobotModel) -> Settings:
    """Return the settings with costmaps, controllers, recoveries and localization fitted to a robot.

    Args:
        settings: Parameters for another robot, whose footprint is the local costmap's. A copy is changed.
        robot: The robot to fit them to. The simulator's parameters are left to the caller.
    """
    made = copy.deepcopy(settings)
    server = made[SERVER]
    limits = SimulationParameters.from_mapping({**settings["simulator"], **robot.settings, "robot": "burger"})
    before = parse_footprint(server["local_costmap"]["footprint"])
    extent, extent_before = np.ptp(robot.footprint, axis=0), np.ptp(before, axis=0)
    scale = float(extent.max() / extent_before.max())
    wider = float(extent[1] / extent_before[1])
    made["amcl"]["laser_max_range"] = limits.scan_range_max
    if robot.drive == OMNIDIRECTIONAL:
        made["amcl"]["odom_model_type"] = "omni"
    for name in ("global_costmap", "local_costmap"):
        _fit_costmap(server[name], robot, limits, scale, wider)
    for entry in server["controllers"]:
        server[entry["name"]] = _fitted_controller(server.get(entry["name"], {}), robot, limits, scale)
    for entry in server["recovery_behaviors"]:
        group = server.setdefault(entry["name"], {})
        if "reset_distance" in group:
            group["reset_distance"] = scale * group["reset_distance"]
    server["oscillation_distance"] = scale * server["oscillation_distance"]
    if robot.drive == CAR:
        server["oscillation_angle"] = CARS_PROGRESS
        server["controllers"] = _that_steer(server)
        server["recovery_behaviors"] = [e for e in server["recovery_behaviors"] if "rotate" not in e["type"]]
    return made


def _fit_costmap(
    group: Dict[str, Any], robot: RobotModel, limits: SimulationParameters, scale: float, wider: float
) -> None:
    """Fit a costmap's parameters in place.

    Args:
        group: The costmap's parameters.
        robot, limits: The robot, its speeds and its lidar's range.
        scale: Its length or width, the larger, in relation to that of the robot the parameters are for.
        wider: Its width in relation. Cells scale by this, up to a factor of four, and not by its length: a long robot
            goes through gaps as narrow as a short one does, and coarse cells would close them.
    """
    group["footprint"] = robot.footprint.tolist()
    group["inflation_radius"] *= scale
    group["cost_scaling_factor"] /= scale
    group["raytrace_range"] = limits.scan_range_max
    group["obstacle_range"] = limits.scan_range_max * 0.85
    if group.get("rolling_window"):
        group["resolution"] *= min(4.0, round(wider)) if wider > 1.0 else 1.0 / min(4.0, round(1.0 / wider))
        braking = limits.max_speed ** 2 / (2.0 * limits.wheel_acceleration)
        side = max(scale * group["width"], 2.0 * (2.0 * limits.max_speed + braking))
        side = group["resolution"] * math.ceil(side / group["resolution"])
        group.update(width=side, height=side)


def _fitted_controller(
    group: Mapping[str, Any], robot: RobotModel, limits: SimulationParameters, scale: float
) -> Dict[str, Any]:
    """Return a controller's parameters with those changed that are set in `group` and depend on the robot.

    Args:
        group: The controller's parameters, of any type of controller.
        robot, limits: The robot, its speeds and accelerations.
        scale: Its size in relation to that of the robot the parameters are for.
    """
    made = copy.deepcopy(dict(group))
    speed, turn = limits.max_speed, 0.95 * limits.max_turn_rate
    aside = speed if robot.drive == OMNIDIRECTIONAL else 0.0
    shares = (1.0, 1.0) if robot.drive == CAR else (STRAIGHT, 1.0 - STRAIGHT)
    acceleration, rim = (share * limits.wheel_acceleration for share in shares)
    turning = rim / (math.hypot(robot.wheels.separation, robot.wheels.base) / 2.0)
    ahead = max(0.325 * scale, LOOK_AHEAD * speed, speed ** 2 / (2.0 * acceleration))
    values = dict(
        max_vel_x=speed, min_vel_x=-speed, max_vel_y=aside, min_vel_y=-aside, max_vel_trans=speed,
        min_vel_trans=0.3 * speed, max_vel_theta=turn, min_vel_theta=0.3 * turn, acc_lim_x=acceleration,
        acc_lim_y=acceleration if aside else 0.0, acc_lim_theta=turning, vy_samples=7 if aside else 0,
        xy_goal_tolerance=0.05 * scale, forward_point_distance=ahead, oscillation_reset_dist=0.05 * scale,
        sim_time=max(1.5, 0.33 * scale / speed, 2.0 * speed / acceleration), scaling_speed=speed,
        desired_linear_vel=speed, lookahead_dist=ahead, vx_max=speed, vx_min=-speed, vy_max=aside, wz_max=turn,
        ax_max=acceleration, ay_max=acceleration, az_max=turning, vx_std=0.45 * speed, wz_std=0.3 * turn,
    )
    made.update({name: value for name, value in values.items() if name in group})
    if "motion_model" in group:
        _fit_samples(made, robot, values, scale)
    return made


def _fit_samples(made: Dict[str, Any], robot: RobotModel, values: Mapping[str, float], scale: float) -> None:
    """Fit in place the parameters that only MPPI has.

    Args:
        made: MPPI's parameters.
        robot: The robot.
        values: Values for the robot, by parameter.
        scale: Its size in relation to that of the robot the parameters are for.
    """
    made["motion_model"] = {CAR: "Ackermann", OMNIDIRECTIONAL: "Omni"}.get(robot.drive, "DiffDrive")
    if robot.drive == CAR:
        made["AckermannConstraints"] = {"min_turning_r": robot.wheels.turning_radius}
        made["min_vel_theta"] = 0.0
    if robot.drive == OMNIDIRECTIONAL:
        made.update(vy_max=values["vy_max"], vy_std=values["vx_std"], ay_max=values["ay_max"])
    for name in ("GoalCritic", "PathFollowCritic"):
        made.setdefault(name, {})["threshold_to_consider"] = 0.5 * max(scale, values["vx_max"] / 0.22)


def _that_steer(server: Mapping[str, Any]) -> List[Dict[str, str]]:
    """Return the entries of the controllers that have a motion_model and thus can drive a car."""
    return [entry for entry in server["controllers"] if "motion_model" in server.get(entry["name"], {})]
