"""Scenes for the controllers' tests: random costmaps, paths and velocities, and the way to kinematics.py."""

import os
import sys

import numpy as np

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", ".."))
from kinematics import TURTLEBOT3  # noqa: E402
from plain_footprint import random_costmap  # noqa: E402

from mbf_relay.control.critics.critic import CriticData  # noqa: E402
from mbf_relay.control.dwa_parameters import DwaParameters  # noqa: E402
from mbf_relay.control.local_path import PathTracker  # noqa: E402
from mbf_relay.control.state import ControlState  # noqa: E402
from mbf_relay.control.trajectories import roll_out, sample, window_of  # noqa: E402
from mbf_relay.costmap.footprint_checker import FootprintChecker  # noqa: E402
from mbf_relay.geometry import Pose2D, Twist2D  # noqa: E402
from mbf_relay.planning.path import Path  # noqa: E402


def burger(**changes):
    return DwaParameters(**{**TURTLEBOT3, **changes})


def random_scene(rng, parameters=None, velocity=None):
    """Return trajectories and the critics' data: a robot near the middle of a random costmap on a random path."""
    parameters = parameters or burger()
    pose = Pose2D(*rng.uniform((-0.05, -0.05, -3.1), (0.05, 0.05, 3.1)))
    velocity = velocity or Twist2D(float(rng.uniform(-0.2, 0.2)), 0.0, float(rng.uniform(-2.0, 2.0)))
    headings = np.cumsum(rng.normal(0.0, 0.15, 60)) + rng.uniform(-3.0, 3.0)
    places = np.cumsum(np.column_stack((np.cos(headings), np.sin(headings))) * 0.02, axis=0)
    tracker = PathTracker()
    tracker.set_path(Path(np.column_stack((places, headings)), "odom"))
    costmap = random_costmap(rng)
    checker = FootprintChecker(costmap)
    path = tracker.cut(ControlState(0.0, pose, velocity, costmap), 0.7, 1.5, 1.0)
    window = window_of(parameters, velocity, 0.1, parameters.max_vel_trans, parameters.max_vel_theta)
    velocities = sample(parameters, window, parameters.max_vel_trans)
    batch = roll_out(parameters, checker, pose, velocity, velocities, 0.1, path.remaining, parameters.sim_time)
    return batch, CriticData(0.0, pose, velocity, path, checker, window)
