"""Straight lines over weighted cells, and string pulling along them."""

import math

import numpy as np
import pytest

from mbf_relay.planning.any_angle import spaced
from mbf_relay.planning.planner import Cancellation
from mbf_relay.planning.search import line_kernels
from mbf_relay.planning.search.incremental_field import CostToGo, FastMarchingPotential
from mbf_relay.planning.weights import global_planner_weights, navfn_weights, path_cost

WEIGHTS = navfn_weights(True)
TABLE = FastMarchingPotential.table_of(WEIGHTS)


def sampled_cost(costs, x0, y0, x1, y1, parts=20000):
    """The line's integral by looking at very many points of it; inf where one lies in a blocked cell."""
    shares = (np.arange(parts) + 0.5) / parts
    columns, rows = np.floor(x0 + shares * (x1 - x0)).astype(int), np.floor(y0 + shares * (y1 - y0)).astype(int)
    return float(TABLE[costs[rows, columns]].mean() * math.hypot(x1 - x0, y1 - y0))


def test_a_lines_cost_is_its_integral_over_the_cells():
    rng = np.random.default_rng(0)
    blocked = 0
    for _ in range(300):
        costs = rng.integers(0, 253, (12, 15)).astype(np.uint8)
        costs[rng.random(costs.shape) < 0.03] = 254
        x0, x1 = rng.uniform(0.0, 15.0, 2)
        y0, y1 = rng.uniform(0.0, 12.0, 2)
        found, expected = line_kernels.line_cost(costs, TABLE, x0, y0, x1, y1), sampled_cost(costs, x0, y0, x1, y1)
        blocked += math.isinf(expected)
        assert found == pytest.approx(expected, rel=2e-3) or (
            math.isinf(found) and expected < math.inf and _grazes(costs, x0, y0, x1, y1)
        )
    assert blocked > 20


def _grazes(costs, x0, y0, x1, y1):
    """Return whether a line passes a blocked cell too shortly for the samples to see."""
    shares = np.linspace(0.0, 1.0, 400001)
    columns = np.clip(np.floor(x0 + shares * (x1 - x0)).astype(int), 0, costs.shape[1] - 1)
    rows = np.clip(np.floor(y0 + shares * (y1 - y0)).astype(int), 0, costs.shape[0] - 1)
    return np.isinf(TABLE[costs[rows, columns]]).any()


def test_steps_between_centres_cost_what_the_search_counts():
    rng = np.random.default_rng(1)
    costs = rng.integers(0, 253, (8, 8)).astype(np.uint8)
    for dx, dy in ((1, 0), (0, 1), (1, 1), (-1, 1)):
        cells = np.array([[4, 4], [4 + dx, 4 + dy]])
        found = line_kernels.line_cost(costs, TABLE, 4.5, 4.5, 4.5 + dx, 4.5 + dy)
        assert found == pytest.approx(path_cost(costs, WEIGHTS, cells))


def test_corners_are_not_cut():
    costs = np.zeros((4, 4), dtype=np.uint8)
    costs[1, 2] = 254
    assert math.isinf(line_kernels.line_cost(costs, TABLE, 1.5, 1.5, 2.5, 2.5))
    assert line_kernels.line_cost(costs, TABLE, 0.5, 1.5, 1.5, 2.5) == pytest.approx(50.0 * math.sqrt(2.0))


@pytest.mark.parametrize("end", [(8.0 - 1e-10, 5.0 + 1e-10), (8.0 - 1e-10, 5.0 - 1e-10), (5.0 + 1e-10, 6.0 - 1e-10)])
@pytest.mark.parametrize("side", [-0.9, 0.9])
def test_a_line_to_a_corner_on_the_maps_border_looks_at_no_cell_beyond_it(end, side):
    memory = np.full(8 * 7, 254, dtype=np.uint8)
    costs = memory[:8 * 6].reshape(6, 8)
    costs[:] = 0
    x, y = (end[0] - 0.5, end[1] + side) if end[0] > 6.0 else (end[0] + side, end[1] - 0.5)
    assert line_kernels.line_cost(costs, TABLE, x, y, *end) == pytest.approx(TABLE[0] * math.hypot(0.5, 0.9))


@pytest.mark.parametrize("seed", range(10))
def test_a_path_pulled_taut_never_costs_more(seed):
    rng = np.random.default_rng(seed)
    costs = rng.integers(0, 100, (40, 40)).astype(np.uint8)
    costs[rng.random(costs.shape) < 0.15] = 254
    costs[2, 2] = costs[37, 36] = 0
    field = CostToGo()
    if not field.reach(costs, WEIGHTS, (2, 2), (36, 37), Cancellation()):
        pytest.skip("no way on this map")
    cells = field.path(costs, (2, 2))
    points = cells + 0.5
    before = line_kernels.polyline_cost(costs, TABLE, points)
    assert before == pytest.approx(path_cost(costs, WEIGHTS, cells))
    count = line_kernels.pull_string(costs, TABLE, points, 60)
    pulled = np.ascontiguousarray(points[:count])
    after = line_kernels.polyline_cost(costs, TABLE, pulled)
    assert after <= before + 1e-6 and count < len(cells)
    assert pulled[0].tolist() == [2.5, 2.5] and pulled[-1].tolist() == [36.5, 37.5]


def plainly_pulled(costs, points, passes):
    """Straighten a path as the kernel says it does, trying everything again in every pass."""
    def line(one, other):
        return line_kernels.line_cost(costs, TABLE, *one, *other)

    points, reach = [tuple(point) for point in points], 0.37
    for _ in range(passes):
        before = list(points)
        for parity in range(2):
            kept, spared = points[:1], parity == 1
            for here, after in zip(points[1:-1], points[2:]):
                spared = not spared and line(kept[-1], after) <= line(kept[-1], here) + line(here, after) + 1e-9
                if not spared:
                    kept.append(here)
            points = kept + points[-1:]
        if points != before:
            continue
        for n in range(1, len(points) - 1):
            x, y = points[n]
            least = line(points[n - 1], points[n]) + line(points[n], points[n + 1])
            least -= 1e-4 * least
            for to in ((x - reach, y), (x + reach, y), (x, y - reach), (x, y + reach)):
                if 0.0 < to[0] < costs.shape[1] and 0.0 < to[1] < costs.shape[0]:
                    moved = line(points[n - 1], to) + line(to, points[n + 1])
                    if moved < least:
                        least, points[n] = moved, to
        if points == before:
            if reach <= 0.25 * 0.37:
                break
            reach *= 0.5
    return np.array(points)


@pytest.mark.parametrize("seed", range(40))
def test_what_was_tried_in_vain_is_left_out_and_the_taut_path_is_the_same(seed):
    rng = np.random.default_rng(100 + seed)
    costs = rng.integers(0, rng.choice([1, 30, 253]), (30, 30)).astype(np.uint8)
    costs[rng.random(costs.shape) < 0.12] = 254
    costs[2, 2] = costs[27, 26] = 0
    field = CostToGo()
    if not field.reach(costs, WEIGHTS, (2, 2), (26, 27), Cancellation()):
        pytest.skip("no way on this map")
    points = field.path(costs, (2, 2)) + 0.5
    for passes in (2, 3, 5, 60):
        pulled = points.copy()
        count = line_kernels.pull_string(costs, TABLE, pulled, passes)
        assert (pulled[:count] == plainly_pulled(costs, points, passes)).all()


def test_over_free_space_a_taut_path_is_one_line():
    costs = np.zeros((50, 50), dtype=np.uint8)
    field = CostToGo()
    field.reach(costs, WEIGHTS, (3, 4), (45, 20), Cancellation())
    points = field.path(costs, (3, 4)) + 0.5
    count = line_kernels.pull_string(costs, TABLE, points, 60)
    length = np.hypot(*np.diff(points[:count], axis=0).T).sum()
    assert length == pytest.approx(math.hypot(42.0, 16.0), rel=1e-3)


def test_points_are_spread_along_lines():
    points = spaced(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.1]]), 0.3)
    assert points.tolist() == [[0.0, 0.0], [0.25, 0.0], [0.5, 0.0], [0.75, 0.0], [1.0, 0.0], [1.0, 0.1]]


def test_weights_are_navfns_and_global_planners():
    assert [WEIGHTS[cost] for cost in (0, 100, 252, 253, 254, 255)] == [50.0, 130.0, 251.0, 0.0, 0.0, 252.0]
    assert navfn_weights(False)[255] == 0.0
    ours = global_planner_weights(50, 3.0, 253, True)
    assert [ours[cost] for cost in (0, 10, 67, 68, 251, 252, 255)] == [50.0, 80.0, 251.0, 252.0, 252.0, 0.0, 252.0]
    assert global_planner_weights(50, 3.0, 253, False)[255] == 0.0
