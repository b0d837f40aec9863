"""A costmap's and its layers' parameters at run time, under costmap_2d's names: `~NAME` and `~NAME/LAYER`."""

from __future__ import annotations

from typing import Any, Callable

import rospy

from mbf_relay.costmap.costmap import Costmap
from mbf_relay.costmap.layer import Layer
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.ros.common import reconfigure


def serve_costmap(costmap: Costmap, wake: Callable[[], None]) -> None:
    """Offer what can be changed in a costmap and in its layers.

    Args:
        costmap: Takes the changes, which show from its next update on.
        wake: Called after each change.
    """
    from mbf_relay.cfg import CostmapConfig

    def apply(parameters: CostmapParameters) -> None:
        costmap.reconfigure(parameters)
        wake()

    # dynamic_reconfigure has no lists, and its server fails on one that stands on the parameter server
    shown = costmap.parameters.replace(footprint=_as_text(costmap.parameters))
    rospy.set_param(f"~{costmap.name}/footprint", shown.footprint)
    reconfigure.serve(CostmapConfig, shown, apply, costmap.name)
    for layer in costmap.layers:
        if "enabled" in layer.parameters.names():
            _serve_layer(costmap, layer, wake)


def _as_text(parameters: CostmapParameters) -> str:
    """Return the footprint as costmap_2d writes it, "[[x, y], ...]"; "[]" where the robot is round."""
    given = parameters.footprint
    return given if isinstance(given, str) else str([[float(x), float(y)] for x, y in given])


def _serve_layer(costmap: Costmap, layer: Layer, wake: Callable[[], None]) -> None:
    def apply(parameters: Any) -> None:
        costmap.reconfigure_layer(layer.name, parameters)
        wake()

    reconfigure.serve(
        reconfigure.load(layer.dynamic_config), layer.parameters, apply, f"{costmap.name}/{layer.name}"
    )
