# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops of the layers: observations prepared, rays drawn over cells, and layers merged into the costmap."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_FREE = 0
_LETHAL = 254
_NO_INFORMATION = 255


@kernel("int64(float64[:,::1], float64[:,::1], float64[::1], float64[:,::1])")
def turn_cloud(points, rotation, translation, ends):
    """Transform points to another frame, leaving out those that are not finite; return how many remain.

    Args:
        points: Shape (N, 3) in metres.
        rotation, translation: Shapes (3, 3) and (3,) in metres: the transform.
        ends: Shape (N, 3), filled from the front with the transformed points.
    """
    number = 0
    for n in range(points.shape[0]):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            continue
        for axis in range(3):
            turned = rotation[axis, 0] * x + rotation[axis, 1] * y + rotation[axis, 2] * z
            ends[number, axis] = turned + translation[axis]
        number += 1
    return number


@kernel(
    "UniTuple(int64, 2)(float64[:,::1], boolean[::1], float64, float64, float64, float64, float64, float64, float64,"
    " float64[:,::1], float64[:,::1], float64[::1])")
def make_ready(points, hits, x, y, z, lowest, highest, highest_mark, obstacle_range, ends, marks, box):
    """Select the rays of an observation that are used, and the ends that become obstacles; return their numbers.

    Args:
        points: End points, shape (N, 2) or (N, 3) in metres; limits on heights apply where there are three columns.
        hits: Shape (N,): whether the ray hit something.
        x, y, z: Position (m) of the sensor.
        lowest, highest: Heights (m) between which points are used.
        highest_mark: Height (m) above which points do not become obstacles.
        obstacle_range: Distance (m) from the sensor from which on points do not become obstacles.
        ends, marks: Shape (N, 2), filled from the front with the ends of rays and with obstacles.
        box: Shape (4,), filled with least x, least y, largest x and largest y of the obstacles and the sensor.
    """
    number, marked = 0, 0
    squared_range = obstacle_range * obstacle_range
    box[0], box[1], box[2], box[3] = x, y, x, y
    for n in range(points.shape[0]):
        end_x, end_y = points[n, 0], points[n, 1]
        if not (math.isfinite(end_x) and math.isfinite(end_y)):
            continue
        across, up = end_x - x, end_y - y
        squared = across * across + up * up
        near = squared < squared_range
        if points.shape[1] > 2:
            height = points[n, 2]
            if not (math.isfinite(height) and lowest <= height <= highest):
                continue
            rise = height - z
            near = squared + rise * rise < squared_range and height <= highest_mark
        ends[number, 0], ends[number, 1] = end_x, end_y
        number += 1
        if near and hits[n]:
            marks[marked, 0], marks[marked, 1] = end_x, end_y
            marked += 1
            box[0], box[1] = min(box[0], end_x), min(box[1], end_y)
            box[2], box[3] = max(box[2], end_x), max(box[3], end_y)
    return number, marked


@kernel("int64(float64, float64, float64[:,::1], int64, float64, float64, int64)")
def _side_by_side(x, y, ends, beam, apart, like, needed):
    """Return how many neighbouring beams hit the same object as beam `beam`; `needed` where that cannot be told.

    The object ends on a side where a beam passes it within `apart` (m) and reaches farther by `like` (m) at least. A
    hit nearer than the object hides it: that beam counts as hitting the object if `needed` is 2; else it is skipped.

    Args:
        x, y: Position (m) of the lidar.
        ends, apart, like, needed: As for `without_lone`; counting stops at `needed`.
        beam: Index of the beam.
    """
    size, row = ends.shape[0], 1
    own_x, own_y = ends[beam, 0] - x, ends[beam, 1] - y
    own = math.hypot(own_x, own_y)
    for step in (-1, 1):
        other, is_end = beam, False
        for _ in range(needed + 1):
            other = (other + step + size) % size
            other_x, other_y = ends[other, 0] - x, ends[other, 1] - y
            reach = math.hypot(other_x, other_y)
            ahead = own_x * other_x + own_y * other_y > 0.0
            if not ahead or abs(own_x * other_y - own_y * other_x) > apart * reach:
                return needed
            is_end = reach >= own + like
            if is_end:
                break
            if needed == 2 or reach > own - like:
                row += 1
            if row >= needed:
                return needed
        if not is_end:
            return needed
    return row


@kernel("UniTuple(int64, 2)(float64, float64, float64[:,::1], float64[:,::1], float64[:,::1], int64[::1], float64, "
        "float64, float64, int64, int64, float64[:,::1])")
def without_lone(x, y, ends, marks, before, scans, apart, like, thin, fewest, most, counted):
    """Select the hits that neighbouring beams or earlier scans confirm; see lone_hits.

    Args:
        x, y: Position (m) of the lidar.
        ends: Shape (N, 2) in metres: ends of its beams, in their order.
        marks: Shape (M, 2) in metres: the hits among them, in the same order.
        before: Shape (K, 2) in metres: hits of earlier scans, one scan after the other.
        scans: Shape (number of those scans,): index in `before` at which each of them ends.
        apart: Metres within which a beam must pass a hit to show that the object ends there.
        like: Metres within which hits of two beams, or of two scans, are of the same object.
        thin: Width (m) of an object on which all beams must hit; 0 to need only `fewest`.
        fewest, most: Limits of the number of hits needed, 2 or more.
        counted: Shape (M, 2), filled from the front with the confirmed hits.

    Returns:
        Number of confirmed hits, and of lone hits without any confirmation.
    """
    number, mark, alone, size = 0, 0, 0, ends.shape[0]
    for beam in range(size):
        if mark == marks.shape[0]:
            break
        mark_x, mark_y = marks[mark, 0], marks[mark, 1]
        if ends[beam, 0] != mark_x or ends[beam, 1] != mark_y:
            continue
        beside_x, beside_y, needed = ends[(beam + 1) % size, 0] - x, ends[(beam + 1) % size, 1] - y, fewest
        pitch = abs((mark_x - x) * beside_y - (mark_y - y) * beside_x)
        while needed < most and needed * pitch < thin * math.hypot(beside_x, beside_y):
            needed += 1
        hits, other = _side_by_side(x, y, ends, beam, apart, like, needed), 0
        is_lone = hits == 1
        for scan in range(scans.shape[0]):
            while hits < needed and other < scans[scan]:
                dx, dy = before[other, 0] - mark_x, before[other, 1] - mark_y
                other += 1
                if dx * dx + dy * dy < like * like:
                    hits, is_lone = hits + 1, False
                    break
            other = scans[scan]
        alone += is_lone
        if hits >= needed:
            counted[number, 0], counted[number, 1] = mark_x, mark_y
            number += 1
        mark += 1
    return number, alone


@kernel("void(uint8[:,::1], float64, float64, float64, float64, float64, float64[:,::1], float64)")
def clear_rays(costs, origin_x, origin_y, resolution, sensor_x, sensor_y, ends, reach):
    """Set the cells from a sensor to each end point to FREE_SPACE, on the lines of costmap_2d's raytraceLine.

    A ray is cut at the grid's border and at `reach`. Nothing is done where the sensor lies outside the grid.

    Args:
        costs: Shape (height, width).
        origin_x, origin_y, resolution: The grid's lower left corner and the side of its cells (m).
        sensor_x, sensor_y: Position of the sensor (m).
        ends: Shape (N, 2) in metres.
        reach: Largest length (cells) of a ray.
    """
    height, width = costs.shape
    first_column = int(math.floor((sensor_x - origin_x) / resolution))
    first_row = int(math.floor((sensor_y - origin_y) / resolution))
    if not (0 <= first_column < width and 0 <= first_row < height):
        return
    far_x, far_y = origin_x + width * resolution, origin_y + height * resolution
    cells = costs.ravel()
    for index in range(ends.shape[0]):
        x, y = ends[index, 0], ends[index, 1]
        dx, dy = x - sensor_x, y - sensor_y
        if x < origin_x:
            x, y = origin_x, sensor_y + dy * (origin_x - sensor_x) / dx
        if y < origin_y:
            x, y = sensor_x + dx * (origin_y - sensor_y) / dy, origin_y
        if x > far_x:
            x, y = far_x - 0.001, sensor_y + dy * (far_x - sensor_x) / dx
        if y > far_y:
            x, y = sensor_x + dx * (far_y - sensor_y) / dy, far_y - 0.001
        column = int(math.floor((x - origin_x) / resolution))
        row = int(math.floor((y - origin_y) / resolution))
        if not (0 <= column < width and 0 <= row < height):
            continue
        length_x, length_y = abs(column - first_column), abs(row - first_row)
        step_x = 1 if column > first_column else -1
        step_y = 1 if row > first_row else -1
        along_x = length_x >= length_y
        longer = length_x if along_x else length_y
        shorter = length_y if along_x else length_x
        distance = math.hypot(length_x, length_y)
        scale = 1.0 if distance == 0.0 else min(1.0, reach / distance)
        steps = min(int(scale * longer), longer)
        error = longer // 2
        ahead, aside = (step_x, step_y * width) if along_x else (step_y * width, step_x)
        cell = first_row * width + first_column
        for _ in range(steps):
            cells[np.uint64(cell)] = _FREE
            error += shorter
            cell += ahead
            if error >= longer:
                error -= longer
                cell += aside
        cells[np.uint64(cell)] = _FREE


@kernel("int64(uint8[:,::1], float64, float64, float64, float64, float64, float64[:,::1], int64[::1])")
def lift_lethal(costs, origin_x, origin_y, resolution, sensor_x, sensor_y, ends, found):
    """Set the lethal cells from a sensor to one cell beyond each end point to FREE_SPACE; return how many there were.

    Args:
        costs, origin_x, origin_y, resolution, sensor_x, sensor_y, ends: As for `clear_rays`.
        found: Shape (M,), filled from the front with these cells as row * width + column; must have room for them.
    """
    height, width = costs.shape
    number = 0
    for index in range(ends.shape[0]):
        dx, dy = ends[index, 0] - sensor_x, ends[index, 1] - sensor_y
        length = math.hypot(dx, dy)
        if length == 0.0:
            continue
        for step in range(int(math.ceil(2.0 * length / resolution)) + 3):
            share = min(0.5 * resolution * step, length + resolution) / length
            column = math.floor((sensor_x + dx * share - origin_x) / resolution)
            row = math.floor((sensor_y + dy * share - origin_y) / resolution)
            if 0 <= column < width and 0 <= row < height and costs[int(row), int(column)] == _LETHAL:
                costs[int(row), int(column)] = _FREE
                found[number] = int(row) * width + int(column)
                number += 1
    return number


@kernel("void(uint8[:,::1], float64, float64, float64, float64[:,::1])")
def mark_points(costs, origin_x, origin_y, resolution, points):
    """Set the cells of points, shape (N, 2) in metres, to LETHAL; points outside the grid are ignored."""
    height, width = costs.shape
    for index in range(points.shape[0]):
        column = math.floor((points[index, 0] - origin_x) / resolution)
        row = math.floor((points[index, 1] - origin_y) / resolution)
        if 0 <= column < width and 0 <= row < height:
            costs[int(row), int(column)] = _LETHAL


@kernel("boolean(uint8[::1], uint8[::1])")
def _differ(old, new):
    """Return whether two rows differ; a kernel of its own, since the compiler does not vectorize nested loops."""
    differs = np.uint8(0)
    for x in range(old.shape[0]):
        differs |= old[x] ^ new[x]
    return differs != 0


@kernel("UniTuple(int64, 4)(uint8[:,::1], uint8[:,::1], int64, int64)")
def changed_part(before, costs, x0, y0):
    """Return the window (x0, y0, x1, y1), ends excluded, of the cells that changed in a part of a grid; 0 for none.

    Args:
        before: The part's costs before, shape (rows, columns).
        costs: The grid's costs now, shape (height, width).
        x0, y0: First column and row of the part.
    """
    rows, columns = before.shape
    left, right, low, high = columns, 0, rows, 0
    for y in range(rows):
        old, new = before[y], costs[y0 + y, x0:x0 + columns]
        if not _differ(old, new):
            continue
        low, high = min(low, y), y + 1
        first = 0
        while old[first] == new[first]:
            first += 1
        last = columns - 1
        while old[last] == new[last]:
            last -= 1
        left, right = min(left, first), max(right, last + 1)
    if high == 0:
        return 0, 0, 0, 0
    return x0 + left, y0 + low, x0 + right, y0 + high


@kernel("void(uint8[::1], uint8[::1])")
def _raise_row(costs, layer):
    """Raise a row to the layer's costs where these are higher; unknown is lowest: as a byte, 255 + 1 is 0."""
    for x in range(costs.shape[0]):
        cost, known = np.uint8(costs[x] + np.uint8(1)), np.uint8(layer[x] + np.uint8(1))
        costs[x] = np.uint8((known if known > cost else cost) - np.uint8(1))


@kernel("void(uint8[:,::1], uint8[:,::1], int64, int64, int64, int64)")
def merge_maximum(costs, layer, x0, y0, x1, y1):
    """Raise a window of `costs` to the layer's costs where these are higher, unknown counting as lowest."""
    for y in range(y0, y1):
        _raise_row(costs[y, x0:x1], layer[y, x0:x1])


@kernel("void(uint8[:,::1], uint8[:,::1], int64, int64, int64, int64)")
def merge_overwrite(costs, layer, x0, y0, x1, y1):
    """Set a window of `costs` to the layer's costs, except where these are unknown."""
    for y in range(y0, y1):
        for x in range(x0, x1):
            if layer[y, x] != _NO_INFORMATION:
                costs[y, x] = layer[y, x]


@kernel("void(uint8[:,::1], int64, int64, int64, int64, float64, float64, float64, uint8[:,::1], float64, float64,"
        " float64, float64, float64, float64, boolean)")
def sample_map(
    costs, x0, y0, x1, y1, origin_x, origin_y, resolution, layer, layer_x, layer_y, layer_resolution, shift_x, shift_y,
    turn, use_maximum,
):
    """Write a map that lies in another frame into a window: each cell takes the map's cell under its centre.

    Args:
        costs, x0, y0, x1, y1: The costmap's costs, shape (height, width), and the window, its ends excluded.
        origin_x, origin_y, resolution: Lower left corner and side (m) of the costmap's cells.
        layer: The map's costs, shape (its height, its width).
        layer_x, layer_y, layer_resolution: Lower left corner and side (m) of the map's cells, in the map's frame.
        shift_x, shift_y, turn: The transform (m, rad) that brings points in the costmap's frame to the map's.
        use_maximum: Only raise costs, unknown counting as lowest; otherwise overwrite.
    """
    height, width = layer.shape
    cos, sin = math.cos(turn), math.sin(turn)
    for y in range(y0, y1):
        world_y = origin_y + (y + 0.5) * resolution
        for x in range(x0, x1):
            world_x = origin_x + (x + 0.5) * resolution
            column = math.floor((shift_x + cos * world_x - sin * world_y - layer_x) / layer_resolution)
            row = math.floor((shift_y + sin * world_x + cos * world_y - layer_y) / layer_resolution)
            if 0 <= column < width and 0 <= row < height:
                cost = layer[int(row), int(column)]
                if not use_maximum or np.uint8(cost + np.uint8(1)) > np.uint8(costs[y, x] + np.uint8(1)):
                    costs[y, x] = cost
