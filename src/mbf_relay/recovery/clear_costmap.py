"""Clears costmap layers, near the robot or far from it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict, Iterator, List, Tuple

from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.outcomes import RecoveryError, RecoveryOutcome, TransformError
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.recovery.recovery import Recovery, RecoveryContext
from mbf_relay.timing import Stopwatch

FRESH_TIMEOUT = 1.0
"""Longest time (s) to wait for an update of the costmaps, which never comes where they are stopped."""

NAMES_BY_DEFAULT = ("obstacles", "obstacle_layer")
"""Usual names of the obstacle layer: in lists of plugins, and costmap_2d's own where there is no list."""


@dataclass(frozen=True)
class ClearCostmapParameters(ParameterSet):
    """Parameters of ClearCostmap, by clear_costmap_recovery's names and defaults."""

    reset_distance: float = parameter(
        3.0, "side of the square around the robot outside which (or with invert_area_to_clear inside which) costmaps "
        "are cleared", "m", minimum=0.0)
    invert_area_to_clear: bool = parameter(False, "clear inside the square instead of outside of it")
    force_updating: bool = parameter(False, "update the costmaps at once instead of waiting for their next update")
    affected_maps: str = parameter(
        "both", "which costmaps to clear", choices=("local", "global", "both"), else_default=True)
    layer_names: Tuple[str, ...] = parameter(NAMES_BY_DEFAULT, "names of the layers to clear")


class ClearCostmap(Recovery):
    """Clears layers of the costmaps and waits until they were updated from the sensors.

    With a large reset_distance it is move_base's conservative reset, with a small one its aggressive reset.

    Source: clear_costmap_recovery/ClearCostmapRecovery, which does not wait, so that the robot may drive through
    obstacles that were just cleared.
    """

    Parameters = ClearCostmapParameters
    parameters: ClearCostmapParameters

    def run(self, context: RecoveryContext) -> Iterator[Twist2D]:
        """Clear, then yield stops until the costmaps were updated; a single one where they are updated here.

        Raises:
            RecoveryError: FAILURE where no costmap has such a layer, TF_ERROR where the robot's pose is not known.
        """
        p = self.parameters
        chosen = ("local", "global") if p.affected_maps == "both" else (p.affected_maps,)
        costmaps = {name: context.costmaps[name] for name in chosen if context.costmaps.get(name) is not None}
        self._check_layers(costmaps)
        for costmap in costmaps.values():
            clear_round_robot(context, costmap, p.layer_names, p.reset_distance, p.invert_area_to_clear)
            if p.force_updating:
                costmap.update(context.now, context.pose_in(costmap.frame))
        yield from stand_until_updated(context, [] if p.force_updating else list(costmaps.values()), context.now)

    def _check_layers(self, costmaps: Dict[str, Any]) -> None:
        names = {layer.name for costmap in costmaps.values() for layer in costmap.layers}
        if not names.intersection(self.parameters.layer_names):
            raise RecoveryError(
                RecoveryOutcome.FAILURE,
                f"'{self.name}' has nothing to clear: none of layer_names {list(self.parameters.layer_names)} is "
                "among the "
                f"layers {sorted(names)} of costmap {' and '.join(costmaps) or self.parameters.affected_maps}",
            )


def clear_round_robot(
    context: RecoveryContext, costmap: Any, layers: Tuple[str, ...], side: float, inside: bool
) -> None:
    """Clear layers of a costmap inside or outside of a square around the robot.

    Args:
        context: For the robot's pose.
        costmap: The costmap.
        layers: Names of the layers.
        side: Side of the square (m).
        inside: Whether to clear the inside; else the outside.

    Raises:
        RecoveryError: TF_ERROR where the robot's pose is not known.
    """
    try:
        pose = context.pose_in(costmap.frame)
    except TransformError as error:
        raise RecoveryError(RecoveryOutcome.TF_ERROR, f"cannot clear round the robot: {error}") from error
    costmap.clear(layers, pose, side, inside)


def stand_until_updated(context: RecoveryContext, costmaps: List[Any], since: float) -> Iterator[Twist2D]:
    """Yield stops until every costmap was updated after `since` (s), for FRESH_TIMEOUT at most."""
    stood = Stopwatch(since)
    yield STOP
    while stood.elapsed(context.now) < FRESH_TIMEOUT and any(costmap.snapshot().stamp <= since for costmap in costmaps):
        yield STOP
