"""What crossing a cell of each cost counts, as the planners users know weigh costs."""

from __future__ import annotations

import functools
import math

import numpy as np

from mbf_relay.costmap.cost_grid import INSCRIBED, NO_INFORMATION, CostGrid

NAVFN_NEUTRAL, NAVFN_FACTOR, NAVFN_HIGHEST = 50.0, 0.8, 252.0
"""navfn's COST_NEUTRAL, COST_FACTOR and the value just below its COST_OBS."""

LENGTHS = np.array([1.0, math.sqrt(2.0)])
"""Cells, of a straight step and of a diagonal one."""
NARROW = 6.0
"""What a cell counts where the robot's sides touch, by what it would count without: a gap as wide as the robot and as
long as it is then worth a way round of some ten times its width."""


@functools.lru_cache(maxsize=2)
def navfn_weights(allow_unknown: bool) -> np.ndarray:
    """Return navfn's weight of each cost: shape (256,), float32, 0 where it does not go. Treat as read-only."""
    weights = np.floor(np.minimum(NAVFN_NEUTRAL + NAVFN_FACTOR * np.arange(256), NAVFN_HIGHEST))
    weights[INSCRIBED:] = 0.0
    if allow_unknown:
        weights[NO_INFORMATION] = NAVFN_HIGHEST
    return np.asarray(weights, dtype=np.float32)


@functools.lru_cache(maxsize=16)
def global_planner_weights(
    neutral_cost: int, cost_factor: float, lethal_cost: int, allow_unknown: bool
) -> np.ndarray:
    """Return global_planner's weight of each cost: shape (256,), float32, 0 where it does not go. Treat as read-only.

    Costs are scaled and capped below `lethal_cost`; from one below `lethal_cost` on, cells are not entered.
    """
    costs = np.arange(256)
    weights = np.minimum(neutral_cost + cost_factor * costs, max(lethal_cost - 1.0, neutral_cost))
    unknown = weights[NO_INFORMATION]
    weights[costs >= lethal_cost - 1] = 0.0
    weights[INSCRIBED:] = 0.0
    weights[NO_INFORMATION] = unknown if allow_unknown else 0.0
    return weights.astype(np.float32)


def path_cost(costs: np.ndarray, weights: np.ndarray, cells: np.ndarray) -> float:
    """Return what a path over neighbouring cells, shape (N, 2), counts: the field's measure in double precision."""
    counted = weights[costs[cells[:, 1], cells[:, 0]]].astype(np.float64)
    moved = cells[1:] != cells[:-1]
    lengths = LENGTHS[(moved[:, 0] & moved[:, 1]).view(np.uint8)]
    return float(((counted[1:] + counted[:-1]) * 0.5 * lengths).sum())


def shy_of_narrow_places(weights: np.ndarray, costmap: CostGrid) -> np.ndarray:
    """Return weights that rise where the robot can hardly turn, up to NARROW times where its sides touch.

    Costs are of the distance to the nearest obstacle, whatever the robot's shape: a path that counts nothing else cuts
    corners by its inscribed circle, and takes a gap that it does not fit through for one that is merely dear.

    Args:
        weights: Shape (256,).
        costmap: Tells at which costs the robot touches.
    """
    turning, side = costmap.turning_cost, costmap.side_cost
    if turning >= side:
        return weights
    return np.asarray(weights * _factors(turning, side), dtype=np.float32)


@functools.lru_cache(maxsize=16)
def _factors(turning: int, side: int) -> np.ndarray:
    """Return by what weights rise: shape (256,); the same for every plan of a robot."""
    share = np.clip((np.arange(256) - turning) / (side - turning), 0.0, 1.0)
    share[INSCRIBED:] = 0.0
    return 1.0 + (NARROW - 1.0) * share * share
