"""Clears costmaps around the robot and limits its speed for a while."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Iterator, Tuple

from mbf_relay.control.state import SpeedLimit
from mbf_relay.geometry import Twist2D
from mbf_relay.parameters import ParameterSet, parameter, without_effect
from mbf_relay.recovery.clear_costmap import NAMES_BY_DEFAULT, clear_round_robot, stand_until_updated
from mbf_relay.recovery.recovery import Recovery, RecoveryContext


@dataclass(frozen=True)
class MoveSlowParameters(ParameterSet):
    """Parameters of MoveSlowAndClear, by move_slow_and_clear's names and defaults."""

    clearing_distance: float = parameter(
        0.5, "half the side of the square around the robot in which costmaps are cleared", "m", minimum=0.0)
    limited_trans_speed: float = parameter(
        0.25, "highest translational speed until limited_distance is driven", "m/s", minimum=0.0)
    limited_rot_speed: float = parameter(
        0.45, "highest rotational speed until limited_distance is driven", "rad/s", minimum=0.0)
    limited_distance: float = parameter(0.3, "distance after which the speed limits end", "m", minimum=0.0)
    layer_names: Tuple[str, ...] = parameter(
        (), "names of the layers to clear; empty for obstacle_layer and all whose names contain 'obstacles'")
    max_trans_param_name: str = without_effect("max_trans_vel", "limits are set in the controller itself")
    max_rot_param_name: str = without_effect("max_rot_vel", "limits are set in the controller itself")
    planner_namespace: str = without_effect("DWAPlannerROS", "the controller that failed is limited")


class MoveSlowAndClear(Recovery):
    """Clears a square around the robot and limits the failed controller's speed until limited_distance is driven.

    Source: move_slow_and_clear/MoveSlowAndClear.
    """

    Parameters = MoveSlowParameters
    parameters: MoveSlowParameters

    def run(self, context: RecoveryContext) -> Iterator[Twist2D]:
        """Clear, limit, and yield stops until the costmaps were updated.

        Raises:
            RecoveryError: TF_ERROR where the robot's pose is not known.
        """
        p = self.parameters
        costmaps = [costmap for costmap in context.costmaps.values() if costmap is not None]
        for costmap in costmaps:
            usual = tuple(layer.name for layer in costmap.layers if _is_usual(layer.name))
            clear_round_robot(context, costmap, p.layer_names or usual, 2.0 * p.clearing_distance, True)
        if context.controller is not None:
            context.controller.limit_speed(SpeedLimit(p.limited_trans_speed, p.limited_rot_speed, p.limited_distance))
        yield from stand_until_updated(context, costmaps, context.now)


def _is_usual(layer: str) -> bool:
    """Return whether a layer is cleared where layer_names is empty; upstream's rule is a name with "obstacles"."""
    return "obstacles" in layer or layer in NAMES_BY_DEFAULT
