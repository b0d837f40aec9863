# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops of the laser models: particles x beams on the map's grid."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

MOST_CELLS = 1 << 24
"""Upper bound of cell indices relative to a pose: they are computed in float32, exact for integers up to this."""


@kernel(
    "float64(float32[:,::1], int64, uint16[::1], int64, float32, float32, float32, float32, float32, float32[::1],"
    " int32[::1])"
)
def sum_inside(ends, beams, codes, first, width, column0, row0, cos, sin, table, cells):
    """Return the sum of the terms of one particle's beams, all of which must end on the map.

    All cell indices are computed first, then all terms are added in four partial sums: loops without branches, which
    compilers vectorize. Indices are relative to a cell before all ends, so that float32 places an end to 1e-4 of a
    cell. They are cast to unsigned integers to avoid numba's handling of negative indices.

    Args:
        ends: Ends of the beams in cells, in the base's frame, shape (2, P); P is a multiple of 8.
        beams: Number of beams, at most P; the columns after them are padding.
        codes: Of the distance field, shape (height * width,), row by row.
        first: Index of the cell that indices are relative to.
        width: Cells in a row of the map.
        column0, row0: Position of the base in cells, relative to that cell.
        cos, sin: Of the base's heading relative to the map's axes.
        table: Term of a beam for each code of the cell it ends in.
        cells: Working memory, shape (P,).
    """
    for j in range(ends.shape[1]):
        column = np.int32(column0 + (cos * ends[0, j] - sin * ends[1, j]))
        row = np.int32(row0 + (sin * ends[0, j] + cos * ends[1, j]))
        cells[j] = np.int32(np.float32(row) * width + np.float32(column))
    around = codes[first:]
    total0, total1, total2, total3 = 0.0, 0.0, 0.0, 0.0
    whole = beams - beams % 4
    for j in range(0, whole, 4):
        total0 += table[np.uint64(around[np.uint32(cells[np.uint64(j)])])]
        total1 += table[np.uint64(around[np.uint32(cells[np.uint64(j + 1)])])]
        total2 += table[np.uint64(around[np.uint32(cells[np.uint64(j + 2)])])]
        total3 += table[np.uint64(around[np.uint32(cells[np.uint64(j + 3)])])]
    for j in range(whole, beams):
        total0 += table[np.uint64(around[np.uint32(cells[np.uint64(j)])])]
    return (total0 + total1) + (total2 + total3)


@kernel("void(float64[:,::1], float64[:,::1], uint16[:,::1], float32[::1], float64, float64[::1], float64[::1])")
def sum_over_endpoints(poses, endpoints, codes, table, outside, frame, sums):
    """Sum for each particle the terms of its beams, looked up by the cells they end in.

    Args:
        poses: Particles, shape (N, 3), in the map's frame.
        endpoints: Shape (B, 2) in metres, in the base's frame.
        codes: Of the distance field, shape (height, width).
        table: Term of a beam for each code of the cell it ends in.
        outside: Term of a beam that ends off the map.
        frame: Origin x, y, theta and resolution of the map, shape (4,).
        sums: Result, shape (N,).
    """
    height, width = codes.shape
    cos_origin, sin_origin = math.cos(frame[2]), math.sin(frame[2])
    scale = 1.0 / frame[3]
    beams = endpoints.shape[0]
    ends = np.zeros((2, (beams + 7) // 8 * 8), np.float32)
    cells, flat, reach, countable = np.empty(ends.shape[1], np.int32), codes.ravel(), 0.0, True
    for j in range(beams):
        ends[0, j], ends[1, j] = endpoints[j, 0] * scale, endpoints[j, 1] * scale
        length = math.hypot(endpoints[j, 0], endpoints[j, 1]) * scale
        countable = countable and length < MOST_CELLS  # False for NaN
        reach = max(reach, length)
    reach += 2.0
    countable = countable and 2.0 * reach * width < MOST_CELLS
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - frame[0], poses[i, 1] - frame[1]
        column0 = (cos_origin * dx + sin_origin * dy) * scale
        row0 = (cos_origin * dy - sin_origin * dx) * scale
        heading = poses[i, 2] - frame[2]
        cos, sin = math.cos(heading), math.sin(heading)
        inside = column0 > reach and row0 > reach and column0 < width - reach and row0 < height - reach
        if countable and inside and abs(cos) <= 1.0:
            column, row = math.floor(column0 - reach), math.floor(row0 - reach)
            sums[i] = sum_inside(
                ends, beams, flat, int(row) * width + int(column), width, column0 - column, row0 - row, cos, sin, table,
                cells,
            )
            continue
        total = 0.0
        for j in range(beams):
            column = column0 + cos * ends[0, j] - sin * ends[1, j]
            row = row0 + sin * ends[0, j] + cos * ends[1, j]
            if column >= 0.0 and row >= 0.0 and column < width and row < height:
                total += table[codes[int(row), int(column)]]
            else:
                total += outside
        sums[i] = total


@kernel("void(float64[:,::1], float64[:,::1], uint16[:,::1], float32[::1], float64, float64[::1], float32[:,::1])")
def look_up_endpoints(poses, endpoints, codes, table, outside, frame, values):
    """Look up the term of each particle's beams, shape (N, B); arguments as of `sum_over_endpoints`."""
    height, width = codes.shape
    cos_origin, sin_origin = math.cos(frame[2]), math.sin(frame[2])
    scale = 1.0 / frame[3]
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - frame[0], poses[i, 1] - frame[1]
        column0 = (cos_origin * dx + sin_origin * dy) * scale
        row0 = (cos_origin * dy - sin_origin * dx) * scale
        heading = poses[i, 2] - frame[2]
        cos, sin = math.cos(heading) * scale, math.sin(heading) * scale
        for j in range(endpoints.shape[0]):
            column = column0 + cos * endpoints[j, 0] - sin * endpoints[j, 1]
            row = row0 + sin * endpoints[j, 0] + cos * endpoints[j, 1]
            if column >= 0.0 and row >= 0.0 and column < width and row < height:
                values[i, j] = table[codes[int(row), int(column)]]
            else:
                values[i, j] = outside


@kernel(
    "void(float32[:,::1], uint8[:,::1], float64, float64, float64, float64[::1], float64[::1], float64[::1],"
    " float64[::1])"
)
def judge_beams(hits, passed, unmapped, most_unmapped, through_walls, logs, hit, through, grazed):
    """Average the beams' log-likelihoods and the shares of their classes at each pose; see `evidence.py`.

    Args:
        hits: Probability, 0 to 1, that each beam ends on a mapped obstacle, shape (K, B); the first pose is the held
            one.
        passed: Whether each beam passes through a mapped obstacle, shape (K, B).
        unmapped: Share of unmapped beams learnt so far; that at the held pose is used where it is larger.
        most_unmapped: Upper bound of the share that is used.
        through_walls: Share of the unmapped beams that pass through an obstacle.
        logs: Result, shape (K,): mean log-likelihood.
        hit: Result, shape (K,): mean of `hits`.
        through, grazed: Results, shape (K,): shares of the beams that pass through an obstacle and end on none, and of
            those that pass through one and hit another.
    """
    poses, beams = hits.shape
    price = 0.0
    for i in range(poses):
        logs[i], hit[i], through[i], grazed[i] = 0.0, 0.0, 0.0, 0.0
        for j in range(beams):
            hit[i] += hits[i, j]
        hit[i] /= beams
        if i == 0:
            price = min(max(unmapped, 1.0 - hit[0]), most_unmapped)
        for j in range(beams):
            wrong = passed[i, j] * (1.0 - hits[i, j])
            through[i] += wrong
            grazed[i] += passed[i, j] * hits[i, j]
            logs[i] += math.log((1.0 - price) * hits[i, j] + price * (1.0 - wrong * (1.0 - through_walls)))
        logs[i] /= beams
        through[i] /= beams
        grazed[i] /= beams


@kernel("float64(uint8[:,::1], float64, float64, float64, float64)")
def cast_ray(blocked, column, row, angle, reach):
    """Return the length (cells) of a ray until it enters a blocked cell or leaves the grid, at most `reach`.

    Traversal from border to border by Amanatides and Woo (1987). Half a cell is added to the length up to the last
    border, so that the mean end is in the middle of the blocked cell.

    Args:
        blocked: Shape (height, width), not 0 where a ray ends.
        column, row: Start of the ray (cells).
        angle: Direction (rad) in the grid's frame.
        reach: Largest length (cells).
    """
    height, width = blocked.shape
    x, y = int(math.floor(column)), int(math.floor(row))
    if x < 0 or y < 0 or x >= width or y >= height or blocked[y, x]:
        return 0.0
    dx, dy = math.cos(angle), math.sin(angle)
    step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
    per_x = abs(1.0 / dx) if abs(dx) > 1e-12 else 1e30
    per_y = abs(1.0 / dy) if abs(dy) > 1e-12 else 1e30
    next_x = (x + 1 - column if step_x > 0 else column - x) * per_x
    next_y = (y + 1 - row if step_y > 0 else row - y) * per_y
    while True:
        if next_x < next_y:
            distance = next_x
            next_x += per_x
            x += step_x
        else:
            distance = next_y
            next_y += per_y
            y += step_y
        if distance >= reach:
            return reach
        if x < 0 or y < 0 or x >= width or y >= height or blocked[y, x]:
            return min(reach, distance + 0.5)


@kernel(
    "void(float64[:,::1], float64[::1], float64[::1], float64[::1], uint8[:,::1], float64[::1], float64, float64[::1],"
    " float64[::1])"
)
def sum_over_rays(poses, ranges, bearings, laser, blocked, frame, range_max, model, sums):
    """Add up the beam model's cubed likelihoods for each particle.

    Args:
        poses: Particles, shape (N, 3), in the map's frame.
        ranges, bearings: Readings (m), with `range_max` for no return, and directions (rad) in the base's frame.
        laser: Position of the sensor in the base's frame, shape (2,).
        blocked: Shape (height, width): where a ray ends.
        frame: Origin x, y, theta and resolution of the map, shape (4,).
        range_max: Longest reading (m).
        model: z_hit, z_short, z_max, z_rand, sigma_hit, lambda_short, shape (6,).
        sums: Result, shape (N,).
    """
    cos_origin, sin_origin = math.cos(frame[2]), math.sin(frame[2])
    resolution = frame[3]
    denominator = 2.0 * model[4] * model[4]
    for i in range(poses.shape[0]):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        dx = poses[i, 0] + cos * laser[0] - sin * laser[1] - frame[0]
        dy = poses[i, 1] + sin * laser[0] + cos * laser[1] - frame[1]
        column = (cos_origin * dx + sin_origin * dy) / resolution
        row = (cos_origin * dy - sin_origin * dx) / resolution
        total = 0.0
        for j in range(ranges.shape[0]):
            angle = poses[i, 2] + bearings[j] - frame[2]
            expected = cast_ray(blocked, column, row, angle, range_max / resolution) * resolution
            error = ranges[j] - expected
            likelihood = model[0] * math.exp(-error * error / denominator)
            if error < 0.0:
                likelihood += model[1] * model[5] * math.exp(-model[5] * ranges[j])
            if ranges[j] >= range_max:
                likelihood += model[2]
            else:
                likelihood += model[3] / range_max
            total += likelihood * likelihood * likelihood
        sums[i] = total


@kernel("void(float64[:,::1], uint8[:,::1], float64[::1], float64, float64[::1], float64[::1])")
def cast_scan(pose, blocked, frame, range_max, bearings, ranges):
    """Simulate the scan of a lidar on the map.

    Args:
        pose: Of the sensor, shape (1, 3), in the map's frame.
        blocked: Shape (height, width): where a ray ends.
        frame: Origin x, y, theta and resolution of the map, shape (4,).
        range_max: Longest range (m).
        bearings: Directions of the beams (rad) in the sensor's frame, shape (B,).
        ranges: Result (m), shape (B,), `range_max` where nothing is hit.
    """
    cos_origin, sin_origin = math.cos(frame[2]), math.sin(frame[2])
    dx, dy = pose[0, 0] - frame[0], pose[0, 1] - frame[1]
    column = (cos_origin * dx + sin_origin * dy) / frame[3]
    row = (cos_origin * dy - sin_origin * dx) / frame[3]
    for j in range(bearings.shape[0]):
        angle = pose[0, 2] + bearings[j] - frame[2]
        ranges[j] = cast_ray(blocked, column, row, angle, range_max / frame[3]) * frame[3]


@kernel(
    "void(float64[:,::1], float64[:,::1], float64[::1], uint16[:,::1], float32[::1], float64[::1], float64,"
    " uint8[:,::1])"
)
def trace_endpoints(poses, endpoints, laser, codes, distances, frame, margin, through):
    """Find the beams that pass through a mapped obstacle.

    Each is followed in steps as long as the distance to the nearest obstacle allows.

    Args:
        poses: Shape (K, 3), in the map's frame.
        endpoints: Where beams end, shape (B, 2) in metres, in the base's frame.
        laser: Position of the sensor in the base's frame, shape (2,).
        codes: Of the distance field, shape (height, width).
        distances: To the nearest occupied cell (m), for each code.
        frame: Origin x, y, theta and resolution of the map, shape (4,).
        margin: Length (m) at both ends of a beam that is not checked, because pose and map are not more exact.
        through: Result, shape (K, B): 1 where a beam passes through an obstacle, else 0.
    """
    height, width = codes.shape
    cos_origin, sin_origin = math.cos(frame[2]), math.sin(frame[2])
    scale = 1.0 / frame[3]
    for i in range(poses.shape[0]):
        cos, sin = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        start_x = poses[i, 0] + cos * laser[0] - sin * laser[1] - frame[0]
        start_y = poses[i, 1] + sin * laser[0] + cos * laser[1] - frame[1]
        for j in range(endpoints.shape[0]):
            end_x = poses[i, 0] + cos * endpoints[j, 0] - sin * endpoints[j, 1] - frame[0]
            end_y = poses[i, 1] + sin * endpoints[j, 0] + cos * endpoints[j, 1] - frame[1]
            length = math.hypot(end_x - start_x, end_y - start_y)
            through[i, j] = 0
            if length <= 2.0 * margin:
                continue
            ux, uy = (end_x - start_x) / length, (end_y - start_y) / length
            gone = margin
            while gone < length - margin:
                dx, dy = start_x + gone * ux, start_y + gone * uy
                column = (cos_origin * dx + sin_origin * dy) * scale
                row = (cos_origin * dy - sin_origin * dx) * scale
                if not (column >= 0.0 and row >= 0.0 and column < width and row < height):
                    break
                distance = distances[codes[int(row), int(column)]]
                if distance == 0.0:
                    through[i, j] = 1
                    break
                gone += max(0.7 * frame[3], distance - frame[3])


@kernel(
    "void(float64[:,::1], float64[:,::1], float64[:,::1], float64[::1], uint16[:,::1], float32[::1], float32[::1],"
    " float64[::1], float64, float64, float64, float64, float64[:,::1])"
)
def judge_scan(
    poses, endpoints, passed, laser, codes, fits, distances, frame, margin, unmapped, most_unmapped, through_walls,
    judged,
):
    """Compute `judge_beams` for a scan's ends, and the share of silent beams that pass through obstacles.

    Args:
        poses, endpoints, laser, codes, distances, frame, margin: As for `trace_endpoints`.
        passed: Points at maximum range along silent beams, shape (S, 2) in metres, in the base's frame.
        fits: Probability, 0 to 1, that a beam ends on an obstacle, for each code of the cell it ends in.
        unmapped, most_unmapped, through_walls: As for `judge_beams`.
        judged: Result, shape (5, K): the four means of `judge_beams`, and the share of the silent beams that pass
            through a mapped obstacle.
    """
    hits = np.empty((poses.shape[0], endpoints.shape[0]), np.float32)
    look_up_endpoints(poses, endpoints, codes, fits, 0.0, frame, hits)
    through = np.empty(hits.shape, np.uint8)
    trace_endpoints(poses, endpoints, laser, codes, distances, frame, margin, through)
    judge_beams(hits, through, unmapped, most_unmapped, through_walls, judged[0], judged[1], judged[2], judged[3])
    silent = np.empty((poses.shape[0], passed.shape[0]), np.uint8)
    trace_endpoints(poses, passed, laser, codes, distances, frame, margin, silent)
    for i in range(poses.shape[0]):
        count = 0
        for j in range(passed.shape[0]):
            count += silent[i, j]
        judged[4, i] = count / max(1, passed.shape[0])
