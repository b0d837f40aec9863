"""One control cycle: ask the controller whether the goal is reached and, if not, for a velocity."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple, Optional

from mbf_relay.control.controller import Controller
from mbf_relay.control.state import ControlState, GoalTolerance
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.planning.path import Path


class ControlAnswer(NamedTuple):
    """A controller's answer in one cycle: the goal is reached, or a velocity (body frame; m/s, rad/s)."""

    arrived: bool
    velocity: Twist2D = STOP


def run_cycle(
    controller: Controller, state: ControlState, path: Optional[Path], is_new_goal: bool,
    tolerance: Optional[GoalTolerance],
) -> ControlAnswer:
    """Run one cycle of a controller; called on the worker.

    With delayed commands `state.pose` is a prediction. The goal counts as reached only if it is reached by the
    predicted and by the present pose: the delay is an estimate from past motion and may no longer hold.

    Args:
        controller: The controller.
        state: Its input.
        path: New path, set before anything else; None to go on along the present one.
        is_new_goal: Whether the new path leads to another goal.
        tolerance: The goal's own tolerance, used instead of the controller's; None for the controller's.
    """
    if path is not None:
        controller.set_path(path, is_new_goal)
    here, arrived = state.pose_now or state.pose, controller.is_goal_reached(state, tolerance)
    if arrived and here != state.pose:
        arrived = controller.is_goal_reached(dataclasses.replace(state, pose=here), tolerance)
    return ControlAnswer(True) if arrived else ControlAnswer(False, controller.compute_velocity(state))
