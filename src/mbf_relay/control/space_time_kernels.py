# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops of the cost to go: the best way through space and time."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel("void(float64[:,:,::1], float64[:,::1], float64[:,::1], float64, float64, int64, int64, float64[:,::1])")
def look_back(dangers, standing, end, price, stroke, first, steps, costs):
    """Find what the best way from each cell on costs, beginning at a layer: dynamic programming from the last one back.

    Args:
        dangers: Shape (T, n, n), n odd: see foresight_kernels.lay.
        standing: Shape (n, n): what each cell costs per layer however nobody passes.
        end: Shape (n, n): what it costs to be in each cell in the end.
        price: What a danger of 1 costs per layer.
        stroke: What driving a cell costs.
        first: Layer to begin at, counted from 0.
        steps: Cells it drives from one layer to the next at most.
        costs: Shape (n, n): filled; infinite where the robot cannot be in that layer, farther out than a step beyond.
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
