"""The controllers the contract is held against, each with the burger's limits."""

import os
import sys

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from kinematics import TURTLEBOT3  # noqa: E402

from mbf_relay.control import CONTROLLERS  # noqa: E402
from mbf_relay.control.controller import Controller  # noqa: E402
from mbf_relay.lockstep.settings import config_folder, load_settings  # noqa: E402
from mbf_relay.plugins import create, find_class  # noqa: E402

EXTRA = {
    "base_local_planner/TrajectoryPlannerROS": dict(
        min_vel_x=0.11,
        escape_vel=-0.22,
        min_vel_theta=-2.75,
        min_in_place_vel_theta=1.37,
        holonomic_robot=False,
        dwa=True,
        meter_scoring=True,
        path_distance_bias=0.75,
        goal_distance_bias=1.0,
        vtheta_samples=40,
        occdist_scale=0.02,
    ),
    "mppi": load_settings(config_folder())["move_base_flex"]["MPPI"],
    "regulated_pure_pursuit": {"desired_linear_vel": 0.22},
}
NAMES = sorted(
    name
    for name in CONTROLLERS
    if not find_class(name, Controller, CONTROLLERS).stands_in and "_controller/" not in name
)
"""Every kind once: without those that stand in for another package's, which drive by one of these."""


def make(name, **changes):
    """Return a controller by the type name users write, with the tutorials' limits."""
    return create(name, name, {**TURTLEBOT3, **EXTRA.get(name, {}), **changes}, Controller, CONTROLLERS)
