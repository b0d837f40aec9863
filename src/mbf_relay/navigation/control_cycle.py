"""One cycle of a controller: whether the robot has arrived, and what it is to do where it has not."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Optional

from mbf_relay.control.controller import Controller
from mbf_relay.control.state import ControlState, GoalTolerance
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.planning.path import Path


class ControlAnswer(NamedTuple):
    """What a controller said in one cycle: that the robot has arrived, or else a velocity."""

    arrived: bool
    velocity: Twist2D = STOP


def run_cycle(
    controller: Controller, state: ControlState, path: Optional[Path], is_new_goal: bool,
    tolerance: Optional[GoalTolerance],
) -> ControlAnswer:
    """Ask a controller; on the worker.

    A robot whose commands come late has arrived only where it also is, not where it is expected: how late they come is
    what it did before, and may be over.

    Args:
        controller: The controller.
        state: What it is told.
        path: Given to it first, where there is a new one.
        is_new_goal: Whether that leads to another goal.
        tolerance: Of the goal, in place of the controller's own.
    """
    if path is not None:
        controller.set_path(path, is_new_goal)
    here, arrived = state.pose_now or state.pose, controller.is_goal_reached(state, tolerance)
    if arrived and here != state.pose:
        arrived = controller.is_goal_reached(dataclasses.replace(state, pose=here), tolerance)
    return ControlAnswer(True) if arrived else ControlAnswer(False, controller.compute_velocity(state))
