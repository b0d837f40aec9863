"""The working data of one control cycle of a PathFollower."""

from __future__ import annotations

from dataclasses import dataclass

from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.state import ControlState
from mbf_relay.control.trajectories import VelocityWindow
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Twist2D


@dataclass(frozen=True)
class ControlCycle:
    """State, path, obstacles and limits of one cycle.

    Attributes:
        state: The argument of compute_velocity.
        path: The part of the path near the robot.
        checker: Footprint checks on the local costmap.
        velocity: Present velocity, body frame: the last command where odometry agrees with it, else as measured.
        window: Dynamic window: velocities reachable within one period, within the limits below.
        speed: Top translational speed (m/s) in this cycle.
        turn: Top rotational speed (rad/s) in this cycle.
        lookahead: Distance (m) ahead on the path to the point that the robot turns to before it drives; at least its
            width.
        horizon_scale: Factor on lookahead distances and times: 1 in open space, less where the path ahead is narrow.
    """

    state: ControlState
    path: LocalPath
    checker: FootprintChecker
    velocity: Twist2D
    window: VelocityWindow
    speed: float
    turn: float
    lookahead: float
    horizon_scale: float = 1.0
