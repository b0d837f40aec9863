"""Inflation against the plainest reading of costmap_2d's formula, cell by cell."""

import math

import numpy as np
import pytest

from mbf_relay.costmap import inflation_kernels
from mbf_relay.costmap.cost_grid import EMPTY, Window
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.inflation_layer import InflationLayer, InflationLayerParameters, cost_table
from mbf_relay.costmap.layer import LayerContext
from mbf_relay.costmap.observation import Observation
from mbf_relay.geometry import IDENTITY
from mbf_relay.grid import Grid


def cost_of_distance(distance, resolution, inscribed, scaling):
    """costmap_2d's InflationLayer::computeCost, of a distance in cells."""
    if distance == 0.0:
        return 254
    metres = distance * resolution
    return 253 if metres <= inscribed else int(252.0 * math.exp(-scaling * (metres - inscribed)))


def brute_force(costs, radius, resolution, inscribed, scaling, inflate_unknown):
    """Every cell takes the cost of its distance to the nearest lethal cell, found by looking at all of them."""
    result = costs.copy()
    rows, columns = np.nonzero(costs == 254)
    reach = math.ceil(radius / resolution)
    for y in range(costs.shape[0]):
        for x in range(costs.shape[1]):
            if len(rows) == 0:
                continue
            distance = math.sqrt(((rows - y) ** 2 + (columns - x) ** 2).min())
            if distance > reach:
                continue
            cost = cost_of_distance(distance, resolution, inscribed, scaling)
            if costs[y, x] == 255:
                if cost > 0 if inflate_unknown else cost >= 253:
                    result[y, x] = cost
            else:
                result[y, x] = max(cost, costs[y, x])
    return result


@pytest.mark.parametrize("seed", range(25))
def test_inflation_equals_brute_force_on_random_maps(seed):
    rng = np.random.default_rng(seed)
    height, width = rng.integers(1, 150), rng.integers(1, 60)
    costs = rng.choice([0, 0, 0, 10, 200, 255], (height, width)).astype(np.uint8)
    costs[rng.random((height, width)) < rng.choice([0.0, 0.002, 0.02, 0.3])] = 254
    if seed % 2 and not (costs == 254).any():
        costs[height // 2] = 254  # a wall right across
    resolution, radius = rng.uniform(0.02, 0.2), rng.uniform(0.0, 1.5)
    inscribed, scaling = rng.uniform(0.0, 0.5), rng.choice([0.0, 1.0, 3.0, 10.0])
    unknown = bool(rng.random() < 0.5)
    layer = InflationLayer("inflation", InflationLayerParameters(True, radius, float(scaling), unknown))
    layer.resize(Grid(resolution, 0.0, 0.0, int(width), int(height)))
    layer.set_footprint(inscribed)
    inflated = costs.copy()
    layer.update_costs(inflated, Window(0, 0, int(width), int(height)))
    assert (inflated == brute_force(costs, radius, resolution, inscribed, scaling, unknown)).all()


@pytest.mark.parametrize("seed", range(20))
def test_inflating_a_window_looks_beyond_it_and_writes_in_it_alone(seed):
    rng = np.random.default_rng(50 + seed)
    costs = np.zeros((90, 80), dtype=np.uint8)
    costs[rng.random(costs.shape) < 0.01] = 254
    table, radius = cost_table(0.6, 3.0, 0.1, 0.05)
    whole = costs.copy()
    inflation_kernels.inflate(whole, 0, 0, 80, 90, table, radius, False)
    x0, x1 = sorted(rng.integers(0, 81, 2))
    y0, y1 = sorted(rng.integers(0, 91, 2))
    window = Window(int(x0), int(y0), int(x1), int(y1))
    expected = costs.copy()
    expected[window.slices] = whole[window.slices]
    inflation_kernels.inflate(costs, *window, table, radius, False)
    assert (costs == expected).all()


def test_radius_ends_where_costs_have_fallen_to_nothing():
    table, radius = cost_table(5.0, 10.0, 0.1, 0.05)
    assert table[radius * radius - 1:].max() <= 1 and radius < 20
    assert cost_table(0.0, 10.0, 0.1, 0.05)[1] == 0


def test_a_radius_of_hundreds_of_cells_is_inflated_too():
    layer = InflationLayer("inflation", InflationLayerParameters(True, 2.5, 0.5, False))
    layer.resize(Grid(0.01, 0.0, 0.0, 400, 300))
    layer.set_footprint(0.1)
    costs = np.zeros((300, 400), dtype=np.uint8)
    costs[20, 30] = costs[250, 390] = 254
    layer.update_costs(costs, Window(0, 0, 400, 300))
    for y in range(0, 300, 7):
        for x in range(0, 400, 5):
            distance = min(math.hypot(x - 30, y - 20), math.hypot(x - 390, y - 250))
            cost = cost_of_distance(distance, 0.01, 0.1, 0.5) if distance <= 250 else 0
            assert costs[y, x] == cost, (x, y)


def test_a_changed_footprint_has_everything_inflated_again():
    layer = InflationLayer("inflation", InflationLayerParameters())
    grid = Grid(0.05, 0.0, 0.0, 50, 40)
    layer.resize(grid)
    context = LayerContext(0.0, IDENTITY, np.zeros((0, 2)))
    assert layer.update_bounds(context, EMPTY) == Window.of(grid)
    assert layer.update_bounds(context, EMPTY).is_empty
    layer.set_footprint(0.2)
    assert layer.update_bounds(context, EMPTY) == Window.of(grid)


def test_nothing_stays_of_what_a_layer_listed_after_it_no_longer_sees():
    """Cells beside which somebody else changed were inflated by a door as well, and stayed so when it was open."""
    costmap = build_costmap("global_costmap", {
        "global_frame": "map", "width": 4.0, "height": 4.0, "resolution": 0.1, "origin_x": -2.0, "origin_y": -2.0,
        "robot_radius": 0.2, "plugins": [
            {"name": "inflation", "type": "costmap_2d::InflationLayer"},
            {"name": "obstacles", "type": "costmap_2d::ObstacleLayer"}],
        "obstacles": {"observation_sources": "scan", "scan": {
            "data_type": "LaserScan", "clearing": True, "marking": True, "obstacle_range": 3.0, "raytrace_range": 3.0}},
    })
    (scan,) = costmap.sources
    door, beside, beyond = (1.05, 0.05), (1.05, 0.35), (1.55, 0.05)
    for now, seen in enumerate((door, beside, beyond, (1.55, 0.5), (-1.0, 0.0)), start=1):
        costmap.observe(scan, Observation((0.0, 0.0), np.array([seen]), None, float(now)))
        costmap.update(float(now), IDENTITY)
    shown = costmap.snapshot()
    assert set(np.unique(shown.costs)) <= {0, 254}
    assert (shown.costs == 254).any() and shown.costs[shown.grid.cell_at(*door)[::-1]] == 0
