"""Marking and clearing against a plain reading of how costmap_2d draws its rays, cell by cell."""

import math

import numpy as np
import pytest

from mbf_relay.costmap import layer_kernels


def traced(costs, grid, sensor, end, reach):
    """Free one ray's cells as costmap_2d's raytraceLine does: Bresenham with the error begun at half the longer side.
    """
    origin_x, origin_y, resolution = grid
    height, width = costs.shape
    x0, y0 = (math.floor((sensor[axis] - grid[axis]) / resolution) for axis in range(2))
    if not (0 <= x0 < width and 0 <= y0 < height):
        return
    wx, wy = end
    a, b = wx - sensor[0], wy - sensor[1]
    far_x, far_y = origin_x + width * resolution, origin_y + height * resolution
    if wx < origin_x:
        wx, wy = origin_x, sensor[1] + b * (origin_x - sensor[0]) / a
    if wy < origin_y:
        wx, wy = sensor[0] + a * (origin_y - sensor[1]) / b, origin_y
    if wx > far_x:
        wx, wy = far_x - 0.001, sensor[1] + b * (far_x - sensor[0]) / a
    if wy > far_y:
        wx, wy = sensor[0] + a * (far_y - sensor[1]) / b, far_y - 0.001
    x1, y1 = math.floor((wx - origin_x) / resolution), math.floor((wy - origin_y) / resolution)
    if not (0 <= x1 < width and 0 <= y1 < height):
        return
    dx, dy = abs(x1 - x0), abs(y1 - y0)
    sx, sy = (1 if x1 > x0 else -1), (1 if y1 > y0 else -1)
    longer, shorter = max(dx, dy), min(dx, dy)
    distance = math.hypot(dx, dy)
    steps = longer if distance == 0.0 else int(min(1.0, reach / distance) * longer)
    for step in range(steps + 1):
        minor = (longer // 2 + step * shorter) // longer if longer else 0
        costs[(y0 + sy * minor, x0 + sx * step) if dx >= dy else (y0 + sy * step, x0 + sx * minor)] = 0


@pytest.mark.parametrize("seed", range(30))
def test_rays_free_the_cells_costmap_2d_frees(seed):
    rng = np.random.default_rng(seed)
    height, width = (int(size) for size in rng.integers(1, 50, 2))
    grid = (rng.uniform(-3.0, 1.0), rng.uniform(-3.0, 1.0), rng.choice([0.05, 0.1, 0.025]))
    costs = rng.choice([0, 100, 254, 255], (height, width)).astype(np.uint8)
    span = np.array([width, height]) * grid[2]
    sensor = np.array(grid[:2]) + rng.uniform(-0.1, 1.1, 2) * span
    ends = np.ascontiguousarray(np.array(grid[:2]) + rng.uniform(-1.0, 2.0, (60, 2)) * span)
    reach = float(rng.integers(1, 60))
    expected = costs.copy()
    for end in ends:
        traced(expected, grid, sensor, end, reach)
    layer_kernels.clear_rays(costs, *grid, sensor[0], sensor[1], ends, reach)
    assert (costs == expected).all()


@pytest.mark.parametrize("seed", range(10))
def test_what_beams_without_a_measurement_pass_is_lifted_and_nothing_else(seed):
    rng = np.random.default_rng(seed)
    height, width, resolution = *(int(size) for size in rng.integers(1, 15, 2)), rng.choice([0.05, 0.1, 0.025])
    origin = rng.uniform(-3.0, 1.0, 2)
    room = np.full((height + 2, width), 254, np.uint8)  # what lies before and behind the grid in memory
    costs = room[1:-1]
    costs[:] = rng.choice([0, 254, 255], (height, width))
    sensor = origin + rng.uniform(-0.1, 1.1, 2) * np.array([width, height]) * resolution
    ends = np.ascontiguousarray(sensor + rng.uniform(-0.5, 0.5, (5, 2)))
    passed = set()
    for end in ends:
        length = np.hypot(*(end - sensor))
        for reach in np.arange(0.0, length + resolution, 0.001):
            column, row = np.floor((sensor + reach / length * (end - sensor) - origin) / resolution).astype(int)
            if 0 <= column < width and 0 <= row < height and costs[row, column] == 254:
                passed.add(row * width + column)
    before, found = costs.copy(), np.full(costs.size, -1)
    lifted = found[:layer_kernels.lift_lethal(costs, *origin, resolution, *sensor, ends, found)]
    assert len(set(lifted)) == len(lifted) and set(lifted) <= passed
    assert len(passed - set(lifted)) <= 2 + 0.25 * len(passed)  # cells of which a beam cuts a corner
    costs.ravel()[lifted] = 254
    assert (costs == before).all() and (room[[0, -1]] == 254).all()


def test_points_are_marked_in_the_cells_that_hold_them():
    rng = np.random.default_rng(1)
    costs = np.zeros((30, 20), dtype=np.uint8)
    points = np.ascontiguousarray(rng.uniform(-1.0, 4.0, (500, 2)))
    layer_kernels.mark_points(costs, -0.5, 0.25, 0.1, points)
    expected = np.zeros_like(costs)
    for x, y in points:
        column, row = math.floor((x + 0.5) / 0.1), math.floor((y - 0.25) / 0.1)
        if 0 <= column < 20 and 0 <= row < 30:
            expected[row, column] = 254
    assert (costs == expected).all()


def test_layers_merge_as_their_names_say():
    rng = np.random.default_rng(2)
    below = rng.choice([0, 50, 254, 255], (20, 20)).astype(np.uint8)
    layer = rng.choice([0, 100, 254, 255], (20, 20)).astype(np.uint8)
    window = (3, 4, 15, 18)
    inside = np.zeros((20, 20), dtype=bool)
    inside[4:18, 3:15] = True
    highest = below.copy()
    layer_kernels.merge_maximum(highest, layer, *window)
    known = inside & (layer != 255)
    assert (highest == np.where(known, np.where(below == 255, layer, np.maximum(below, layer)), below)).all()
    over = below.copy()
    layer_kernels.merge_overwrite(over, layer, *window)
    assert (over == np.where(known, layer, below)).all()


def test_a_map_in_another_frame_is_sampled_at_cell_centres():
    rng = np.random.default_rng(3)
    layer = rng.integers(0, 256, (40, 50)).astype(np.uint8)
    costs = np.full((30, 30), 7, dtype=np.uint8)
    shift_x, shift_y, turn = 0.4, 0.3, 0.7
    layer_kernels.sample_map(
        costs, 0, 0, 30, 30, -0.5, -0.6, 0.05, layer, -0.2, -0.1, 0.04, shift_x, shift_y, turn, False)
    for row in range(30):
        for column in range(30):
            x, y = -0.5 + (column + 0.5) * 0.05, -0.6 + (row + 0.5) * 0.05
            at_x = shift_x + math.cos(turn) * x - math.sin(turn) * y
            at_y = shift_y + math.sin(turn) * x + math.cos(turn) * y
            map_column, map_row = math.floor((at_x + 0.2) / 0.04), math.floor((at_y + 0.1) / 0.04)
            inside = 0 <= map_column < 50 and 0 <= map_row < 40
            assert costs[row, column] == (layer[map_row, map_column] if inside else 7)


@pytest.mark.parametrize("seed", range(30))
def test_what_of_an_observation_counts_is_chosen_as_with_whole_arrays(seed):
    rng = np.random.default_rng(seed)
    columns, count = (3 if seed % 3 else 2), int(rng.integers(0, 80))
    points = rng.normal(0.0, 2.0, (count, columns))
    points[rng.random((count, columns)) < 0.05] = np.nan
    points[rng.random((count, columns)) < 0.05] = np.inf
    hits = rng.random(count) < 0.7
    (x, y, z), (lowest, highest, highest_mark, reach) = rng.normal(0.0, 1.0, 3), (-1.0, 2.0, 1.0, 2.5)

    with np.errstate(invalid="ignore"):
        kept = np.isfinite(points).all(axis=1)
        squared = (points[:, 0] - x) ** 2 + (points[:, 1] - y) ** 2
        marks = hits & (squared < reach ** 2)
        if columns > 2:
            kept &= (points[:, 2] >= lowest) & (points[:, 2] <= highest)
            marks = hits & (squared + (points[:, 2] - z) ** 2 < reach ** 2) & (points[:, 2] <= highest_mark)
    marked = points[kept & marks, :2]

    ends_found, marks_found, box = np.empty((count, 2)), np.empty((count, 2)), np.empty(4)
    numbers = layer_kernels.make_ready(
        points, hits, x, y, z, lowest, highest, highest_mark, reach, ends_found, marks_found, box)
    assert numbers == (kept.sum(), len(marked))
    assert (ends_found[:numbers[0]] == points[kept, :2]).all() and (marks_found[:numbers[1]] == marked).all()
    around = np.vstack((marked, [[x, y]]))
    assert box.tolist() == [*around.min(axis=0), *around.max(axis=0)]
