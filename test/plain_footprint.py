"""A plain walk round a footprint on a costmap: what the compiled checker is held against."""

import math

import numpy as np
from kinematics import BURGER

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid


def random_costmap(rng, obstacles=12, cells=60, footprint=BURGER):
    grid = Grid(0.05, -1.5, -1.5, cells, cells)
    costs = rng.integers(0, 253, grid.shape).astype(np.uint8)
    places = rng.integers(0, cells, (obstacles, 2))
    costs[places[:, 1], places[:, 0]] = 254
    costs[cells // 2 - 4 : cells // 2 + 4, cells // 2 - 4 : cells // 2 + 4] = 0
    return CostGrid(grid, costs, "odom", footprint, 0.041, 0.149)


def grazes(costs, column, row, in_x, in_y, overlap):
    sides = [(in_x < overlap, -1, 0), (in_x > 1 - overlap, 1, 0), (in_y < overlap, 0, -1), (in_y > 1 - overlap, 0, 1)]
    return any(
        near
        and 0 <= column + dx < costs.shape[1]
        and 0 <= row + dy < costs.shape[0]
        and costs[row + dy, column + dx] < 254
        for near, dx, dy in sides
    )


def contacts(costmap, pose, scale=1.0, headings=256, outside=1):
    """Walk round the outline in thirds of a cell, its heading rounded to one of so many; return the points in contact.
    """
    grid, overlap, found = costmap.grid, costmap.obstacle_overlap, 0
    step = 2 * math.pi / headings
    turned = Pose2D(pose.x, pose.y, round(pose.theta / step) * step)
    corners = costmap.footprint
    for start, end in zip(corners, np.roll(corners, -1, axis=0)):
        count = max(1, math.ceil(np.hypot(*(end - start)) / (grid.resolution / 3)))
        along = np.float32(start + (end - start) * np.arange(count)[:, None] / count) * scale
        places = turned.transform_points(along)
        cells = grid.cells_at(places)
        inside = ((cells >= 0) & (cells < (grid.width, grid.height))).all(axis=1)
        found += outside * int(np.count_nonzero(~inside))
        places, cells = places[inside], cells[inside]
        touching = costmap.costs[cells[:, 1], cells[:, 0]] >= 254
        for (x, y), (column, row) in zip(places[touching], cells[touching]):
            in_x = (x - grid.origin_x) / grid.resolution - column
            in_y = (y - grid.origin_y) / grid.resolution - row
            found += not grazes(costmap.costs, column, row, in_x, in_y, overlap)
    return found
