"""The compiled searches against plain ones: the same algorithm, cell for cell and bit for bit."""

import math

import numpy as np
import pytest

from mbf_relay.planning.planner import Cancellation
from mbf_relay.planning.search import cost_to_go_kernels, fast_marching_kernels, queue_kernels
from mbf_relay.planning.search.incremental_field import CostToGo, FastMarchingPotential
from mbf_relay.planning.weights import navfn_weights

F = np.float32
SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))
CORNERS = ((-1, -1), (1, -1), (-1, 1), (1, 1))


def plain_grow(shape, goal, start, inverse_width, neighbours, key_of):
    """Grow a field as the docstrings of the kernels' `grow` say; return it and how many cells were expanded.

    Args:
        shape: Rows and columns.
        goal, start: Column and row.
        inverse_width: One over the width of a bucket.
        neighbours: Called with field and cell; yields the neighbours and what they hold through the cell.
        key_of: Called with a cell and its value; what it is sorted into buckets by.
    """
    field = np.zeros(shape, dtype=F)
    field[goal[1], goal[0]] = F(queue_kernels.ROOT_VALUE)
    base = int(key_of(goal, field[goal[1], goal[0]]) * inverse_width)
    buckets, expanded = {base: [(goal, field[goal[1], goal[0]])]}, 0
    while True:
        entries = buckets.get(base, [])
        if not entries:
            reached = field[start[1], start[0]]
            if (reached > 0.0 and F(base + 1) > reached * inverse_width) or not any(buckets.values()):
                return field, expanded
            base += 1
            continue
        (x, y), value = entries.pop(0)
        if value != field[y, x]:
            continue
        expanded += 1
        for (near_x, near_y), through in list(neighbours(field, x, y)):
            if field[near_y, near_x] == 0.0 or through < field[near_y, near_x]:
                field[near_y, near_x] = through
                bucket = max(int(key_of((near_x, near_y), through) * inverse_width), base)
                buckets.setdefault(bucket, []).append(((near_x, near_y), through))


def random_map(seed):
    rng = np.random.default_rng(seed)
    costs = rng.integers(0, 200, rng.integers(2, 40, 2)).astype(np.uint8)
    costs[rng.random(costs.shape) < 0.25] = 254
    rows, columns = np.nonzero(costs < 254)
    goal, start = ((int(columns[i]), int(rows[i])) for i in rng.integers(len(rows), size=2))
    return costs, goal, start


def inverse_width_of(field, weights, slope):
    widest = F(1.5) * (weights.max() + slope) / F(queue_kernels.BUCKETS - 3)
    return F(1.0) / max(field._slope * field.bucket, widest)


@pytest.mark.parametrize("seed", range(15))
def test_cost_to_go_grows_as_its_docstring_says(seed):
    costs, goal, start = random_map(seed)
    weights = navfn_weights(allow_unknown=True)
    halves = CostToGo.table_of(weights)[costs]
    field = CostToGo()
    field.reach(costs, weights, start, goal, Cancellation())
    slope, diagonal = field._slope, F(math.sqrt(2.0))

    def neighbours(known, x, y):
        def may_enter(to_x, to_y):
            inside = 0 <= to_x < costs.shape[1] and 0 <= to_y < costs.shape[0]
            return inside and halves[to_y, to_x] < np.inf

        for dx, dy in SIDES + CORNERS:
            if may_enter(x + dx, y + dy) and may_enter(x + dx, y) and may_enter(x, y + dy):
                both = halves[y, x] + halves[y + dy, x + dx]
                yield (x + dx, y + dy), known[y, x] + (both * diagonal if dx and dy else both)

    def key_of(cell, value):
        far, near = sorted((abs(cell[0] - start[0]), abs(cell[1] - start[1])), reverse=True)
        return value + slope * (F(far) + F(math.sqrt(2.0) - 1.0) * F(near))

    expected, expanded = plain_grow(
        costs.shape, goal, start, inverse_width_of(field, weights, slope), neighbours, key_of
    )
    assert np.array_equal(field.field(), expected) and field.expanded == expanded


@pytest.mark.parametrize("seed", range(15))
def test_fast_marching_grows_as_its_docstring_says(seed):
    costs, goal, start = random_map(seed)
    weights = navfn_weights(allow_unknown=True)
    table = FastMarchingPotential.table_of(weights)[costs]
    field = FastMarchingPotential()
    field.reach(costs, weights, start, goal, Cancellation(), all_around=True)

    def value_at(known, x, y):
        inside = 0 <= x < costs.shape[1] and 0 <= y < costs.shape[0]
        return known[y, x] if inside and known[y, x] > 0.0 else F(np.inf)

    def neighbours(known, x, y):
        found = []
        for dx, dy in SIDES:
            to_x, to_y = x + dx, y + dy
            if not (0 <= to_x < costs.shape[1] and 0 <= to_y < costs.shape[0]) or table[to_y, to_x] == np.inf:
                continue
            other = min(value_at(known, to_x + dy, to_y + dx), value_at(known, to_x - dy, to_y - dx))
            cost, gap = table[to_y, to_x], abs(known[y, x] - other)
            arrival = min(known[y, x], other) + cost
            if gap < cost:
                root = F(math.sqrt(max(F(2.0) * cost * cost - gap * gap, F(0.0))))
                arrival = F(0.5) * (known[y, x] + other + root)
            found.append(((to_x, to_y), arrival))
        return found

    inverse_width = inverse_width_of(field, weights, F(0.0))
    expected, expanded = plain_grow(costs.shape, goal, start, inverse_width, neighbours, lambda cell, value: value)
    assert np.array_equal(field.field(), expected) and field.expanded == expanded


@pytest.mark.parametrize("module", [cost_to_go_kernels, fast_marching_kernels, queue_kernels])
def test_copies_of_the_layout_are_like_the_original(module):
    layout = {f"_{name}": value for name, value in vars(queue_kernels).items() if name.isupper() and name[0] != "_"}
    layout["_ROOT"] = layout.pop("_ROOT_VALUE")
    copies = {name: value for name, value in vars(module).items() if name in layout}
    assert copies == {name: layout[name] for name in copies} and len(copies) >= 7


def test_changed_cells_are_found_row_by_row():
    rng = np.random.default_rng(4)
    for trial in range(40):
        seen = rng.integers(0, 256, (23, 37)).astype(np.uint8)
        costs = np.where(rng.random(seen.shape) < 0.02 * (trial % 4), seen + 1, seen).astype(np.uint8)
        x0, y0, x1, y1 = rng.integers(0, 10), rng.integers(0, 10), rng.integers(11, 38), rng.integers(11, 24)
        expected = [(x, y) for y in range(y0, y1) for x in range(x0, x1) if costs[y, x] != seen[y, x]]
        changed = np.empty((len(expected), 2), dtype=np.int32)
        assert queue_kernels.changed_cells(costs, seen, x0, y0, x1, y1, changed) == len(expected)
        assert changed.tolist() == [list(cell) for cell in expected]
        if expected:
            assert queue_kernels.changed_cells(costs, seen, x0, y0, x1, y1, changed[1:]) == -1


@pytest.mark.parametrize("seed", range(20))
def test_all_that_is_known_beside_a_change_waits_again(seed):
    rng = np.random.default_rng(seed)
    field = np.where(rng.random((23, 37)) < rng.choice((0.02, 0.5)), rng.uniform(1.0, 9.0, (23, 37)), 0.0).astype(F)
    changed = np.column_stack((rng.integers(0, 37, 50), rng.integers(0, 23, 50))).astype(np.int32)
    forgotten = (rng.integers(0, 23, 60) * 65536 + rng.integers(0, 37, 60)).astype(np.int32)
    middles = [(int(cell) & 65535, int(cell) >> 16) for cell in forgotten[:40]] + changed.tolist()
    expected = [
        (row * 65536 + column, field[row, column])
        for x, y in middles for row in range(max(y - 1, 0), min(y + 2, 23))
        for column in range(max(x - 1, 0), min(x + 2, 37)) if field[row, column] > 0.0]
    state = np.zeros(queue_kernels.STATE_SIZE, np.int64)
    store = np.zeros(900, np.int32), np.zeros(900, np.float32)
    assert queue_kernels.requeue(field, changed, forgotten, 40, *store, state) == len(expected)
    assert list(zip(*(part[:len(expected)].tolist() for part in store))) == expected


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("is_empty", [True, False])
def test_both_fields_move_alike_what_waits_into_the_ring(seed, is_empty):
    """A kernel that another calls stays in its file, so there are two; where nothing is added to values they agree."""
    made = []
    for spread, more in ((queue_kernels.spread, ()), (fast_marching_kernels._spread_within, (F(np.inf),))):
        rng = np.random.default_rng(seed)
        sizes, state = np.zeros(queue_kernels.BUCKETS, np.int64), np.zeros(queue_kernels.STATE_SIZE, np.int64)
        cells, keys = np.zeros((len(sizes), 100), np.int32), np.zeros((len(sizes), 100), np.float32)
        state[queue_kernels.APART] = count = int(3000 * rng.random() ** 3)
        state[queue_kernels.WAITING], state[queue_kernels.BASE] = 0 if is_empty else 1, rng.integers(0, 9)
        store = rng.integers(0, 1 << 20, 3000, dtype=np.int32), rng.uniform(9.0, 99.0, 3000).astype(np.float32)
        moved = spread(sizes, cells, keys, *store, state, 5, 7, F(0.0), F(rng.uniform(0.2, 2.0)), *more)
        made.append([moved, sizes, cells, keys, state, *(part[:count] for part in store)])
    assert all(np.array_equal(one, other) for one, other in zip(*made))
