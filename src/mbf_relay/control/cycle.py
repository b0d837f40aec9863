"""What a controller that follows a path works on in one cycle."""

from __future__ import annotations

from dataclasses import dataclass

from mbf_relay.control.local_path import LocalPath
from mbf_relay.control.state import ControlState
from mbf_relay.control.trajectories import VelocityWindow
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Twist2D


@dataclass(frozen=True)
class ControlCycle:
    """What one cycle works on.

    Attributes:
        state: As handed in.
        path: The path round the robot.
        checker: The obstacles.
        velocity: The velocity the robot is at: the last command where it followed that, else as measured.
        window: The velocities in reach, within the top speeds for now.
        speed: Top translational speed (m/s) for now.
        turn: Top rotational speed (rad/s) for now.
        lookahead: Distance (m) ahead on the path whose direction the robot faces before it drives; its width at least.
        horizon_scale: 1 in the open, less where the path ahead is narrow: by how much to shorten what the robot looks
            ahead.
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
