# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over the cells a footprint covers on a grid, and over the points of its outline.

Lines are drawn as costmap_2d draws them: Bresenham's algorithm, the error term starting at half the longer side.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_LETHAL = 254
_NO_INFORMATION = 255
_FREE = 0
_INSCRIBED = 253


@kernel("int64(int64[::1], int64[::1], int32[:,::1])")
def polygon_cells(columns, rows, cells):
    """Collect the cells of a convex polygon, outline and inside.

    The outline is drawn line by line; each row is then filled between its outermost cells.

    Args:
        columns, rows: Shape (K,): the corners' cells, in order around the polygon.
        cells: Shape (M, 2), int32, filled with columns and rows; M at least the cells of the polygon's bounding box.

    Returns:
        How many cells there are.
    """
    lowest, highest = rows.min(), rows.max()
    left = np.full(highest - lowest + 1, columns.max(), np.int64)
    right = np.full(highest - lowest + 1, columns.min(), np.int64)
    corners = columns.shape[0]
    for corner in range(corners):
        column, row = columns[corner - 1], rows[corner - 1]
        end_column, end_row = columns[corner], rows[corner]
        step_x = 1 if end_column >= column else -1
        step_y = 1 if end_row >= row else -1
        length_x = abs(end_column - column)
        length_y = abs(end_row - row)
        along_x = length_x >= length_y
        longer = length_x if along_x else length_y
        shorter = length_y if along_x else length_x
        error = longer // 2
        for _ in range(longer + 1):
            left[row - lowest] = min(left[row - lowest], column)
            right[row - lowest] = max(right[row - lowest], column)
            error += shorter
            turn = error >= longer
            if turn:
                error -= longer
            if along_x:
                column += step_x
                if turn:
                    row += step_y
            else:
                row += step_y
                if turn:
                    column += step_x
    count = 0
    for line in range(highest - lowest + 1):
        for column in range(left[line], right[line] + 1):
            cells[count, 0] = column
            cells[count, 1] = lowest + line
            count += 1
    return count


@kernel("int64(int64, int64, float64, float64, float64, float64[:,::1], float64, float64, float64, int32[:,::1])")
def cells_within(width, height, origin_x, origin_y, resolution, footprint, x, y, theta, cells):
    """Collect the cells of a grid that lie wholly within a convex footprint.

    Args:
        width, height: Size of the grid.
        origin_x, origin_y, resolution: The grid's lower left corner and the side of its cells (m).
        footprint: Corners in the base frame, shape (K, 2) in metres with K > 2, clockwise or counter-clockwise.
        x, y, theta: Pose of the base (m, rad) in the grid's frame.
        cells: Shape (M, 2), filled with columns and rows; M at least the cells of the footprint's bounding box.

    Returns:
        How many cells there are.
    """
    corners = len(footprint)
    cos, sin = math.cos(theta), math.sin(theta)
    outline = np.empty((corners, 2))
    for i in range(corners):
        outline[i, 0] = x + cos * footprint[i, 0] - sin * footprint[i, 1]
        outline[i, 1] = y + sin * footprint[i, 0] + cos * footprint[i, 1]
    area = 0.0
    for i in range(corners):
        area += (outline[i - 1, 0] - x) * (outline[i, 1] - y) - (outline[i - 1, 1] - y) * (outline[i, 0] - x)
    turn = 1.0 if area > 0.0 else -1.0
    left = max(0, int(math.floor((outline[:, 0].min() - origin_x) / resolution)))
    right = min(width - 1, int(math.floor((outline[:, 0].max() - origin_x) / resolution)))
    low = max(0, int(math.floor((outline[:, 1].min() - origin_y) / resolution)))
    high = min(height - 1, int(math.floor((outline[:, 1].max() - origin_y) / resolution)))
    count = 0
    for row in range(low, high + 1):
        for column in range(left, right + 1):
            cell_x, cell_y = column * resolution + origin_x, row * resolution + origin_y
            inside = True
            for i in range(corners):
                edge_x, edge_y = turn * (outline[i, 0] - outline[i - 1, 0]), turn * (outline[i, 1] - outline[i - 1, 1])
                # The corner of the cell that lies farthest outside of this edge.
                out_x = cell_x + resolution if edge_y > 0.0 else cell_x
                out_y = cell_y if edge_x > 0.0 else cell_y + resolution
                if edge_x * (out_y - outline[i - 1, 1]) - edge_y * (out_x - outline[i - 1, 0]) < 0.0:
                    inside = False
                    break
            if inside:
                cells[count, 0], cells[count, 1] = column, row
                count += 1
    return count


@kernel("void(uint8[:,::1], float64, float64, float64, float64[:,::1], float64, float64, float64)")
def free_within(costs, origin_x, origin_y, resolution, footprint, x, y, theta):
    """Set the cells of `cells_within` to FREE_SPACE in `costs`, shape (height, width); other arguments as there."""
    height, width = costs.shape
    reach = 0.0
    for i in range(len(footprint)):
        reach = max(reach, math.hypot(footprint[i, 0], footprint[i, 1]))
    side = int(2.0 * reach / resolution) + 2
    cells = np.empty((min(side, width) * min(side, height), 2), np.int32)
    for cell in range(cells_within(width, height, origin_x, origin_y, resolution, footprint, x, y, theta, cells)):
        costs[cells[cell, 1], cells[cell, 0]] = _FREE


@kernel("void(uint8[:,::1], float64, float64, float64, float64[:,::1], float64[:,::1], int64[:,::1])")
def covered_costs(costs, origin_x, origin_y, resolution, footprint, poses, result):
    """Count the cells of each kind that a filled convex footprint covers at each pose.

    Args:
        costs: Shape (height, width).
        origin_x, origin_y, resolution: As for `cells_within`.
        footprint: Corners in the base frame, shape (K, 2) in metres; fewer than three stand for the base's own cell.
        poses: Shape (N, 3): x, y, theta in the grid's frame.
        result: Shape (N, 5), filled with: 1 where a corner lies outside the grid (the rest is 0 then); the numbers of
            lethal, inscribed and unknown cells; and the sum of the other cells' costs.
    """
    height, width = costs.shape
    corners = max(footprint.shape[0], 1)
    columns, rows = np.empty(corners, np.int64), np.empty(corners, np.int64)
    for index in range(poses.shape[0]):
        x, y, theta = poses[index, 0], poses[index, 1], poses[index, 2]
        cos, sin = math.cos(theta), math.sin(theta)
        result[index, :] = 0
        columns[0] = int(math.floor((x - origin_x) / resolution))
        rows[0] = int(math.floor((y - origin_y) / resolution))
        if footprint.shape[0] >= 3:
            for corner in range(corners):
                columns[corner] = int(
                    math.floor((x + cos * footprint[corner, 0] - sin * footprint[corner, 1] - origin_x) / resolution))
                rows[corner] = int(
                    math.floor((y + sin * footprint[corner, 0] + cos * footprint[corner, 1] - origin_y) / resolution))
        low_column, high_column, low_row, high_row = columns.min(), columns.max(), rows.min(), rows.max()
        if low_column < 0 or high_column >= width or low_row < 0 or high_row >= height:
            result[index, 0] = 1
            continue
        cells = np.empty(((high_column - low_column + 1) * (high_row - low_row + 1), 2), np.int32)
        for cell in range(polygon_cells(columns, rows, cells)):
            cost = costs[cells[cell, 1], cells[cell, 0]]
            if cost == _LETHAL:
                result[index, 1] += 1
            elif cost == _INSCRIBED:
                result[index, 2] += 1
            elif cost == _NO_INFORMATION:
                result[index, 3] += 1
            else:
                result[index, 4] += cost


@kernel("void(float64[:,::1], int64, float64, float32[:,:,::1], float32[:,::1], float32[:,:,::1])")
def draw(ring, length, hair, outlines, boxes, arcs):
    """Turn the points of an outline to each of A headings of a full circle, with bounding boxes and circles.

    Args:
        ring: Shape (P, 2): points (m) around the outline at heading 0.
        length: Points of an arc.
        hair: Margin (m) by which boxes and circles are larger than needed.
        outlines: Shape (A, P, 2), filled with the turned points.
        boxes: Shape (A, 4), filled with least x, least y, largest x and largest y.
        arcs: Shape (A, K, 3), filled with centre and radius of a circle around each `length` consecutive points.
    """
    headings, points = outlines.shape[0], ring.shape[0]
    for heading in range(headings):
        angle = heading * (2.0 * math.pi / headings)
        cos, sin = math.cos(angle), math.sin(angle)
        low_x, low_y, high_x, high_y = math.inf, math.inf, -math.inf, -math.inf
        for arc in range(arcs.shape[1]):
            first, last = length * arc, min(length * (arc + 1), points)
            center_x = center_y = square = 0.0
            for point in range(first, last):
                x = cos * ring[point, 0] - sin * ring[point, 1]
                y = sin * ring[point, 0] + cos * ring[point, 1]
                outlines[heading, point, 0], outlines[heading, point, 1] = x, y
                center_x += x
                center_y += y
                low_x, low_y, high_x, high_y = min(low_x, x), min(low_y, y), max(high_x, x), max(high_y, y)
            center_x /= last - first
            center_y /= last - first
            for point in range(first, last):
                away_x, away_y = outlines[heading, point, 0] - center_x, outlines[heading, point, 1] - center_y
                square = max(square, away_x * away_x + away_y * away_y)
            arcs[heading, arc, 0], arcs[heading, arc, 1] = center_x, center_y
            arcs[heading, arc, 2] = math.sqrt(square) + hair
        boxes[heading, 0], boxes[heading, 1] = low_x - hair, low_y - hair
        boxes[heading, 2], boxes[heading, 3] = high_x + hair, high_y + hair
