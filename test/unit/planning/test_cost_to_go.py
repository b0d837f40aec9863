"""The cost-to-go field: exact, whatever is kept, changed or continued."""

import heapq
import math

import numpy as np
import pytest

from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning.planner import Cancellation
from mbf_relay.planning.search import queue_kernels
from mbf_relay.planning.search.incremental_field import CostToGo, FastMarchingPotential
from mbf_relay.planning.weights import navfn_weights, path_cost

WEIGHTS = navfn_weights(allow_unknown=True)


def reference_cost(costs, weights, start, goal):
    """Dijkstra's algorithm with a heap and double precision, as plain as can be; inf where there is no way."""
    height, width = costs.shape
    free = weights[costs] > 0.0
    counted = weights[costs].astype(float)
    best = {start: 0.0}
    queue = [(0.0, start)]
    while queue:
        cost, (x, y) = heapq.heappop(queue)
        if (x, y) == goal:
            return cost
        if cost > best[(x, y)]:
            continue
        for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
            to_x, to_y = x + dx, y + dy
            if not (0 <= to_x < width and 0 <= to_y < height and free[to_y, to_x]):
                continue
            if dx and dy and not (free[y, to_x] and free[to_y, x]):
                continue
            through = cost + (counted[y, x] + counted[to_y, to_x]) / 2.0 * math.hypot(dx, dy)
            if through < best.get((to_x, to_y), math.inf):
                best[(to_x, to_y)] = through
                heapq.heappush(queue, (through, (to_x, to_y)))
    return math.inf


def random_map(rng, height, width, blocked=0.3):
    costs = rng.integers(0, 253, (height, width)).astype(np.uint8)
    costs[rng.random((height, width)) < blocked] = 254
    costs[rng.random((height, width)) < 0.05] = 255
    return costs


def plan(field, costs, weights, start, goal, cancelled):
    """Return path and cost, None where there is no way."""
    if not field.reach(costs, weights, start, goal, cancelled):
        return None
    path = field.path(costs, start)
    return path, path_cost(costs, weights, path)


def free_cell(rng, costs):
    rows, columns = np.nonzero(WEIGHTS[costs] > 0.0)
    index = rng.integers(len(rows))
    return int(columns[index]), int(rows[index])


def check_path(costs, start, goal, found):
    path, cost = found
    assert tuple(path[0]) == start and tuple(path[-1]) == goal
    assert (WEIGHTS[costs[path[:, 1], path[:, 0]]] > 0.0).all()
    steps = np.diff(path, axis=0)
    assert (np.abs(steps).max(axis=1) == 1).all() if len(steps) else True
    for (x, y), (dx, dy) in zip(path[:-1], steps):
        if dx and dy:
            assert WEIGHTS[costs[y, x + dx]] > 0.0 and WEIGHTS[costs[y + dy, x]] > 0.0
    assert cost == pytest.approx(path_cost(costs, WEIGHTS, path))


@pytest.mark.parametrize("seed", range(12))
def test_costs_are_those_of_dijkstras_algorithm(seed):
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 40, 2)
    field = CostToGo()
    for _ in range(20):
        costs = random_map(rng, height, width, rng.choice([0.0, 0.2, 0.4]))
        if not (WEIGHTS[costs] > 0.0).any():
            continue
        start, goal = free_cell(rng, costs), free_cell(rng, costs)
        found = plan(field, costs, WEIGHTS, start, goal, Cancellation())
        expected = reference_cost(costs, WEIGHTS, start, goal)
        assert (found is None) == math.isinf(expected)
        if found is not None:
            check_path(costs, start, goal, found)
            assert found[1] == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize("seed", range(8))
def test_replanning_after_changes_costs_what_planning_from_scratch_costs(seed):
    rng = np.random.default_rng(100 + seed)
    costs = random_map(rng, 60, 70, 0.25)
    goal = free_cell(rng, costs)
    kept = CostToGo()
    repairs = 0
    for step in range(40):
        start = free_cell(rng, costs)
        found = plan(kept, costs, WEIGHTS, start, goal, Cancellation())
        scratch = plan(CostToGo(), costs, WEIGHTS, start, goal, Cancellation())
        assert (found is None) == (scratch is None), step
        if found is not None:
            check_path(costs, start, goal, found)
            assert found[1] == pytest.approx(scratch[1], rel=2e-6), step
        repairs += bool(kept.invalidated)
        for _ in range(rng.integers(0, 3)):  # a patch is blocked, freed or changed, in place
            x, y = rng.integers(0, 65), rng.integers(0, 55)
            patch = costs[y:y + rng.integers(1, 6), x:x + rng.integers(1, 6)]
            patch[:] = rng.choice([254, 0]) if rng.random() < 0.7 else rng.integers(0, 253, patch.shape)
        costs[goal[1], goal[0]] = 0
    assert repairs > 5


def test_an_unchanged_map_is_only_read():
    rng = np.random.default_rng(5)
    costs = random_map(rng, 80, 80, 0.1)
    costs[3, 3] = costs[70, 70] = 0
    field = CostToGo()
    first = plan(field, costs, WEIGHTS, (3, 3), (70, 70), Cancellation())
    assert field.expanded > 1000
    for cell in first[0][::10]:
        found = plan(field, costs, WEIGHTS, tuple(cell), (70, 70), Cancellation())
        assert field.expanded == 0 and field.invalidated == 0
        assert found[1] == pytest.approx(reference_cost(costs, WEIGHTS, tuple(cell), (70, 70)), rel=2e-6)


def test_a_local_change_is_repaired_locally():
    costs = np.zeros((300, 300), dtype=np.uint8)
    field = CostToGo()
    plan(field, costs, WEIGHTS, (10, 10), (290, 280), Cancellation())
    whole = field.expanded
    costs[18:21, 18:21] = 254
    found = plan(field, costs, WEIGHTS, (10, 10), (290, 280), Cancellation())
    assert found[1] == pytest.approx(reference_cost(costs, WEIGHTS, (10, 10), (290, 280)), rel=2e-6)
    assert field.invalidated is not None and field.expanded < whole / 5


@pytest.mark.parametrize("kind", [CostToGo, FastMarchingPotential])
def test_after_a_long_drive_a_new_map_is_still_planned_on_anew(kind):
    """All that the updates on the way had expanded counted as the field's, and a new map took four times as long."""
    rng = np.random.default_rng(1)
    costs, field, start, goal = np.full((120, 120), 20, np.uint8), kind(), (10, 10), (110, 110)
    for _ in range(200):
        x, y = rng.integers(20, 90, 2)
        costs[y:y + 8, x:x + 8] = rng.integers(0, 200)
        field.reach(costs, WEIGHTS, start, goal, Cancellation())
    assert field.invalidated is not None
    costs[20:100, 20:100] = rng.integers(0, 200, (80, 80))
    field.reach(costs, WEIGHTS, start, goal, Cancellation())
    assert field.invalidated is None


def test_cost_grows_with_the_free_area_not_with_the_map():
    small, large = np.full((200, 200), 254, np.uint8), np.full((3000, 3000), 254, np.uint8)
    small[50:150, 50:150] = large[50:150, 50:150] = 10
    expanded = []
    for costs in (small, large):
        field = CostToGo()
        assert plan(field, costs, WEIGHTS, (60, 60), (140, 130), Cancellation()) is not None
        expanded.append(field.expanded)
    assert expanded[0] == expanded[1]


def test_a_cancelled_plan_says_so_and_leaves_the_field_good():
    costs = np.zeros((400, 400), dtype=np.uint8)
    costs[1::4, :-1] = 254
    costs[3::4, 1:] = 254
    cancelled = Cancellation()
    cancelled.cancel()
    field = CostToGo()
    with pytest.raises(PlanningError) as error:
        plan(field, costs, WEIGHTS, (0, 0), (5, 398), cancelled)
    assert error.value.outcome is PlanOutcome.CANCELED
    assert field.expanded <= 2 * 4096
    found = plan(field, costs, WEIGHTS, (0, 0), (5, 398), Cancellation())
    assert found[1] == pytest.approx(reference_cost(costs, WEIGHTS, (0, 0), (5, 398)), rel=1e-5)


def test_weights_that_differ_by_far_are_still_exact():
    rng = np.random.default_rng(9)
    weights = np.where(np.arange(256) < 253, 1.0 + 5.0 * np.arange(256), 0.0).astype(np.float32)
    field = CostToGo()
    for _ in range(30):
        costs = random_map(rng, 40, 40, 0.2)
        costs[costs == 255] = 254
        start, goal = free_cell(rng, costs), free_cell(rng, costs)
        found = plan(field, costs, weights, start, goal, Cancellation())
        expected = reference_cost(costs, weights, start, goal)
        assert (found is None) == math.isinf(expected)
        if found is not None:
            assert found[1] == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize("seed", range(10))
def test_no_connected_cell_costs_less_than_said(seed):
    rng = np.random.default_rng(seed)
    free = np.arange(256) < 253
    for _ in range(20):
        costs = rng.integers(1, 253, (30, 25)).astype(np.uint8)
        costs[rng.random(costs.shape) < 0.45] = 254
        x, y = (int(value) for value in rng.integers(0, 25, 2))
        costs[y, x] = 100
        reached, waiting = {(x, y)}, [(x, y)]
        while waiting:
            column, row = waiting.pop()
            for cell in ((column + 1, row), (column - 1, row), (column, row + 1), (column, row - 1)):
                if 0 <= cell[0] < 25 and 0 <= cell[1] < 30 and cell not in reached and costs[cell[1], cell[0]] < 253:
                    reached.add(cell)
                    waiting.append(cell)
        lowest = min(costs[row, column] for column, row in reached)
        assert 0 <= queue_kernels.lowest_connected(costs, free, x, y, 0) <= lowest


def test_what_lies_behind_closed_walls_does_not_count():
    free = np.arange(256) < 253
    costs = np.zeros((60, 60), dtype=np.uint8)
    y, x = np.mgrid[0:60, 0:60]
    costs[np.hypot(x - 30, y - 30) < 22] = 90
    costs[np.hypot(x - 30, y - 30) < 5] = 70
    costs[abs(np.hypot(x - 30, y - 30) - 22) < 1.5] = 254
    assert queue_kernels.lowest_connected(costs, free, 20, 20, 0) == 70
    assert queue_kernels.lowest_connected(costs, free, 20, 20, 80) == 80
    assert queue_kernels.lowest_connected(costs, free, 0, 0, 0) == 0
