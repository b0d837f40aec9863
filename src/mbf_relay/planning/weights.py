"""Weights: a path's cost per cell of length for each cell cost, by the formulas of navfn and global_planner."""

from __future__ import annotations

import functools
import math

import numpy as np

from mbf_relay.costmap.cost_grid import INSCRIBED, NO_INFORMATION, CostGrid

NAVFN_NEUTRAL, NAVFN_FACTOR, NAVFN_HIGHEST = 50.0, 0.8, 252.0
"""navfn's COST_NEUTRAL, COST_FACTOR and the value just below its COST_OBS."""

LENGTHS = np.array([1.0, math.sqrt(2.0)])
"""Lengths (cells) of a straight step and of a diagonal one."""
NARROW = 6.0
"""Factor on a cell's weight where the robot's sides would touch: a gap as wide and as long as the robot then costs as
much as a way around of some ten times its width."""


@functools.lru_cache(maxsize=2)
def navfn_weights(allow_unknown: bool) -> np.ndarray:
    """Return navfn's weights: shape (256,), float32, 0 for costs it does not enter. Treat as read-only."""
    weights = np.floor(np.minimum(NAVFN_NEUTRAL + NAVFN_FACTOR * np.arange(256), NAVFN_HIGHEST))
    weights[INSCRIBED:] = 0.0
    if allow_unknown:
        weights[NO_INFORMATION] = NAVFN_HIGHEST
    return np.asarray(weights, dtype=np.float32)


@functools.lru_cache(maxsize=16)
def global_planner_weights(
    neutral_cost: int, cost_factor: float, lethal_cost: int, allow_unknown: bool
) -> np.ndarray:
    """Return global_planner's weights: shape (256,), float32, 0 for costs it does not enter. Treat as read-only.

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
    """Return the cost of a path over 8-connected cells as `CostToGo` defines it, in double precision.

    Args:
        costs: Shape (height, width), uint8.
        weights: Shape (256,).
        cells: Shape (N, 2): columns and rows in path order.
    """
    counted = weights[costs[cells[:, 1], cells[:, 0]]].astype(np.float64)
    moved = cells[1:] != cells[:-1]
    lengths = LENGTHS[(moved[:, 0] & moved[:, 1]).view(np.uint8)]
    return float(((counted[1:] + counted[:-1]) * 0.5 * lengths).sum())


def shy_of_narrow_places(weights: np.ndarray, costmap: CostGrid) -> np.ndarray:
    """Return weights raised where the robot cannot turn on the spot, up to NARROW times where its sides touch.

    Inflated costs depend on the distance to the nearest obstacle, not on the robot's shape: with them alone a path cuts
    corners at the inscribed radius, and gaps the robot does not fit through are merely expensive.

    Args:
        weights: Shape (256,).
        costmap: Its `turning_cost` and `side_cost` say at which costs the robot touches.
    """
    turning, side = costmap.turning_cost, costmap.side_cost
    if turning >= side:
        return weights
    return np.asarray(weights * _factors(turning, side), dtype=np.float32)


@functools.lru_cache(maxsize=16)
def _factors(turning: int, side: int) -> np.ndarray:
    """Return the factor for each cell cost, shape (256,): 1 up to `turning`, rising to NARROW at `side`."""
    share = np.clip((np.arange(256) - turning) / (side - turning), 0.0, 1.0)
    share[INSCRIBED:] = 0.0
    return 1.0 + (NARROW - 1.0) * share * share
