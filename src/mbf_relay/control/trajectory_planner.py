"""move_base's default local planner: base_local_planner's TrajectoryPlannerROS, by its parameters."""

from __future__ import annotations

import math
from typing import Tuple, Type

from mbf_relay.control.dwa import DwaController
from mbf_relay.control.dwa_parameters import DwaParameters
from mbf_relay.control.follower import PathFollower
from mbf_relay.control.trajectory_planner_parameters import TrajectoryPlannerParameters
from mbf_relay.control.translated import TranslatedController

FORWARD_ONLY = 5.0
"""Cost of driving backwards at full speed, in metres off the path: as upstream, it only backs out if all else fails."""

HEADING_SCALE = 0.3
"""Cost of a radian between the heading and the farthest point in sight, as in base_local_planner."""


class TrajectoryPlanner(TranslatedController):
    """Trajectory rollout, or with `dwa` the dynamic window approach; both driven by DwaController.

    Both sample velocities, simulate each within accelerations and take the cheapest by distance to the path, distance
    left to the goal and highest cost passed. They differ in the velocities sampled: DwaController's `use_dwa`.

    Source: Gerkey, Konolige, "Planning and control in unstructured terrain" (2008), and
    base_local_planner/TrajectoryPlannerROS, whose parameters it reads.
    """

    Parameters = TrajectoryPlannerParameters
    parameters: TrajectoryPlannerParameters
    dynamic_config = "mbf_relay.cfg.TrajectoryPlannerConfig"

    def translate(
        self, parameters: TrajectoryPlannerParameters, resolution: float
    ) -> Tuple[Type[PathFollower], DwaParameters]:
        """Return DwaController and the parameters translated for it."""
        return DwaController, as_dwa(parameters, resolution)


def as_dwa(p: TrajectoryPlannerParameters, resolution: float) -> DwaParameters:
    """Return DWA's parameters for the same robot and the same weights.

    Args:
        p: TrajectoryPlannerROS's.
        resolution: Cell size (m): without meter_scoring, distances are weighed in cells. With it they are weighed in
            metres, and occdist_scale is multiplied by the cell size, as upstream.
    """
    a_metre, a_cost = (1.0, resolution) if p.meter_scoring else (1.0 / resolution, 1.0)
    sideways, turn = p.sideways(), p.turning()
    fastest = math.hypot(p.max_vel_x, sideways)
    critics = ("heading",) if p.heading_scoring else ()
    return DwaParameters(
        max_vel_trans=fastest, min_vel_trans=min(p.min_vel_x, fastest), max_vel_x=p.max_vel_x,
        min_vel_x=min(0.0, p.escape_vel), max_vel_y=sideways, min_vel_y=-sideways, max_vel_theta=turn,
        min_vel_theta=min(p.min_in_place_vel_theta, turn), acc_lim_x=p.acc_lim_x, acc_lim_y=p.acc_lim_y,
        acc_lim_theta=p.acc_lim_theta, xy_goal_tolerance=p.xy_goal_tolerance, yaw_goal_tolerance=p.yaw_goal_tolerance,
        latch_xy_goal_tolerance=p.latch_xy_goal_tolerance, stop_time_buffer=p.stop_time_buffer, sim_time=p.sim_time,
        sim_granularity=p.sim_granularity, angular_sim_granularity=p.angular_sim_granularity, use_dwa=p.dwa,
        vx_samples=p.vx_samples, vth_samples=p.vtheta_samples, path_distance_bias=a_metre * p.path_distance_bias,
        goal_distance_bias=a_metre * p.goal_distance_bias, occdist_scale=a_cost * p.occdist_scale,
        prefer_forward_scale=FORWARD_ONLY, forward_point_distance=p.heading_lookahead,
        oscillation_reset_dist=p.oscillation_reset_dist, heading_scale=HEADING_SCALE,
        heading_time=p.heading_scoring_timestep, critics=DwaParameters().critics + critics,
        publish_cost_grid_pc=p.publish_cost_grid_pc,
    )
