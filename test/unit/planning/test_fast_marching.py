"""The fast-marching potential against a plain fast-marching reference, and the way down on it."""

import heapq
import math

import numpy as np
import pytest

from mbf_relay.planning.planner import Cancellation
from mbf_relay.planning.search import queue_kernels
from mbf_relay.planning.search.incremental_field import FastMarchingPotential
from mbf_relay.planning.weights import navfn_weights

WEIGHTS = navfn_weights(allow_unknown=True)


def reference_potential(costs, goal):
    """Relax cells until none gets lower, with a heap and double precision; inf where the front does not come."""
    height, width = costs.shape
    weights = WEIGHTS[costs].astype(float)
    potential = np.full(costs.shape, np.inf)
    potential[goal[1], goal[0]] = 0.0
    queue = [(0.0, goal)]

    def known(x, y):
        return potential[y, x] if 0 <= x < width and 0 <= y < height else math.inf

    while queue:
        value, (x, y) = heapq.heappop(queue)
        if value > potential[y, x]:
            continue
        for to_x, to_y in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
            if not (0 <= to_x < width and 0 <= to_y < height) or weights[to_y, to_x] == 0.0:
                continue
            weight = weights[to_y, to_x]
            across = min(known(to_x - 1, to_y), known(to_x + 1, to_y))
            along = min(known(to_x, to_y - 1), known(to_x, to_y + 1))
            low, high = min(across, along), max(across, along)
            lowered = low + weight
            if high - low < weight:
                lowered = (low + high + math.sqrt(2.0 * weight ** 2 - (high - low) ** 2)) / 2.0
            if lowered < potential[to_y, to_x] * (1.0 - 1e-12):
                potential[to_y, to_x] = lowered
                heapq.heappush(queue, (lowered, (to_x, to_y)))
    return potential


def random_map(rng, blocked):
    height, width = (int(size) for size in rng.integers(1, 40, 2))
    costs = (rng.integers(0, 253, (height, width)) * rng.choice([0, 1])).astype(np.uint8)
    costs[rng.random(costs.shape) < blocked] = 254
    return costs


def free_cell(rng, costs):
    rows, columns = np.nonzero(costs < 253)
    index = rng.integers(len(rows))
    return int(columns[index]), int(rows[index])


@pytest.mark.parametrize("seed", range(12))
def test_the_potential_is_that_of_fast_marching(seed):
    rng = np.random.default_rng(seed)
    potential = FastMarchingPotential()
    for _ in range(15):
        costs = random_map(rng, rng.choice([0.0, 0.2, 0.4]))
        if not (costs < 253).any():
            continue
        start, goal = free_cell(rng, costs), free_cell(rng, costs)
        expected = reference_potential(costs, goal)
        assert potential.reach(costs, WEIGHTS, start, goal, Cancellation()) == math.isfinite(
            expected[start[1], start[0]]
        )
        if math.isfinite(expected[start[1], start[0]]):
            assert potential.cost_at(start[0] + 0.5, start[1] + 0.5) == pytest.approx(
                expected[start[1], start[0]], rel=1e-4, abs=1e-2
            )
        if potential.reach(costs, WEIGHTS, start, goal, Cancellation(), all_around=True):
            nearer = expected < expected[start[1], start[0]]
            found = potential.field()[nearer] - queue_kernels.ROOT_VALUE
            assert found == pytest.approx(expected[nearer], rel=1e-4, abs=1e-2)


@pytest.mark.parametrize("seed", range(6))
def test_repaired_potentials_are_those_grown_from_scratch(seed):
    rng = np.random.default_rng(100 + seed)
    costs = rng.integers(0, 150, (45, 55)).astype(np.uint8)
    costs[rng.random(costs.shape) < 0.2] = 254
    goal = free_cell(rng, costs)
    potential, updates = FastMarchingPotential(), 0
    for _ in range(30):
        start = free_cell(rng, costs)
        expected = reference_potential(costs, goal)[start[1], start[0]]
        assert potential.reach(costs, WEIGHTS, start, goal, Cancellation()) == math.isfinite(expected)
        if math.isfinite(expected):
            assert potential.cost_at(start[0] + 0.5, start[1] + 0.5) == pytest.approx(expected, rel=1e-4, abs=1e-2)
        updates += bool(potential.invalidated)
        x, y = rng.integers(0, 50), rng.integers(0, 40)
        costs[y:y + rng.integers(1, 5), x:x + rng.integers(1, 5)] = rng.choice([254, 0, 90])
        costs[goal[1], goal[0]] = 0
    assert updates > 5


def test_the_way_down_is_straight_over_free_space():
    costs = np.zeros((60, 80), dtype=np.uint8)
    potential = FastMarchingPotential()
    assert potential.reach(costs, WEIGHTS, (5, 7), (70, 40), Cancellation())
    points = potential.path((5.5, 7.5))
    length = np.hypot(*np.diff(points, axis=0).T).sum()
    assert length == pytest.approx(math.hypot(65.0, 33.0), rel=0.02)
    steps = np.hypot(*np.diff(points, axis=0).T)
    assert steps.max() < 1.5
    line = (points - points[0]) @ np.array([-33.0, 65.0]) / math.hypot(65.0, 33.0)
    assert abs(line).max() < 2.0


def test_large_free_space_is_looked_at_once():
    costs = np.zeros((400, 400), dtype=np.uint8)
    potential = FastMarchingPotential()
    assert potential.reach(costs, WEIGHTS, (20, 30), (380, 300), Cancellation())
    assert potential.expanded < 1.3 * np.count_nonzero(potential.field())
