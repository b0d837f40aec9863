# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loop of the cost to go in space and time."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel("void(float64[:,:,::1], float64[:,::1], float64[:,::1], float64, float64, int64, int64, float64[:,::1])")
def look_back(dangers, standing, end, price, stroke, first, steps, costs):
    """Find the cost of the best way on from each cell at a layer, by dynamic programming from the last layer back.

    Args:
        dangers: Shape (T, n, n), n odd: see foresight_kernels.lay.
        standing: Shape (n, n): cost of each cell per layer, by static obstacles.
        end: Shape (n, n): cost of being in each cell after the last layer.
        price: Cost of a danger of 1 per layer.
        stroke: Cost of driving one cell.
        first: Index of the layer to begin at.
        steps: Cells that the robot drives between two layers at most.
        costs: Shape (n, n): filled; infinite one step beyond the cells that the robot can reach by that layer.
    """
    layers, side = dangers.shape[0], dangers.shape[1]
    half = side // 2
    now, before = end.copy(), np.empty((side, side))
    for t in range(layers - 1, first, -1):
        reach = min(half - steps, steps * (t + 2))
        before[:] = np.inf
        total = now + price * dangers[t] + standing
        for row in range(half - reach, half + reach + 1):
            for column in range(half - reach, half + reach + 1):
                best = np.inf
                for dy in range(-steps, steps + 1):
                    for dx in range(-steps, steps + 1):
                        squared = dx * dx + dy * dy
                        if squared <= steps * steps:
                            cost = total[row + dy, column + dx]
                            if squared > 0:
                                cost += stroke * math.sqrt(squared)
                            if cost < best:
                                best = cost
                before[row, column] = best
        now, before = before, now
    costs[:] = now
