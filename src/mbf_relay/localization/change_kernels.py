# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops that count, block by block of the map, how many beams agree with the map and how many do not."""

from __future__ import annotations

import math

from mbf_relay.kernels import kernel

LIKE, UNLIKE, FREE = 0, 1, 2
"""Rows of the counts: beams that end on a mapped obstacle; beams that end where none is mapped, or pass through one;
and beams that pass through a block without meeting a mapped obstacle."""


@kernel(
    "int64(float64[::1], float64[:,::1], float64[::1], int8[:,::1], uint16[:,::1], float32[::1], float32[::1],"
    " float64[::1], float64, int64, float32[:,::1], int64[::1])"
)
def count_beams(pose, endpoints, laser, data, codes, hits, distances, frame, margin, side, counts, touched):
    """Count one scan's beams in the blocks they pass and end in.

    Each beam is followed in steps as long as the distance to the nearest obstacle allows.

    Args:
        pose: Of the base, shape (3,), in the map's frame.
        endpoints: Ends of the beams with a return, shape (B, 2) in metres, in the base's frame.
        laser: Position (m) of the sensor in the base's frame, shape (2,).
        data: Occupancy of the map, shape (height, width); beams that end in unknown space (below 0) are not counted.
        codes: Of the distance field, shape (height, width).
        hits: For each code the likelihood, 0 to 1, that a beam ending there hit a mapped obstacle.
        distances: To the nearest occupied cell (m), for each code.
        frame: Origin x, y, theta and resolution of the map, shape (4,).
        margin: Length (m) at both ends of a beam within which it is not checked for obstacles.
        side: Side of a block (cells).
        counts: Result, shape (3, blocks), row by row of the map; zero at the call.
        touched: Result, shape (blocks,): indices of the blocks with a count, as many as the value returned.

    Returns:
        The number of blocks with a count.
    """
    height, width = codes.shape
    columns = (width + side - 1) // side
    cos, sin = math.cos(pose[2] - frame[2]), math.sin(pose[2] - frame[2])
    cos_origin, sin_origin = math.cos(frame[2]), math.sin(frame[2])
    dx, dy = pose[0] - frame[0], pose[1] - frame[1]
    base_x, base_y = cos_origin * dx + sin_origin * dy, cos_origin * dy - sin_origin * dx
    start_x, start_y = base_x + cos * laser[0] - sin * laser[1], base_y + sin * laser[0] + cos * laser[1]
    scale, found = 1.0 / frame[3], 0
    for j in range(endpoints.shape[0]):
        end_x = base_x + cos * endpoints[j, 0] - sin * endpoints[j, 1]
        end_y = base_y + sin * endpoints[j, 0] + cos * endpoints[j, 1]
        length = math.hypot(end_x - start_x, end_y - start_y)
        if length < 1e-9:
            continue
        ux, uy = (end_x - start_x) / length, (end_y - start_y) / length
        gone, last, last_through, ended = min(margin, length), -1, -1, False
        while not ended:
            ended = gone >= length - margin
            at = length if ended else gone
            column, row = (start_x + at * ux) * scale, (start_y + at * uy) * scale
            if not (column >= 0.0 and row >= 0.0 and column < width and row < height):
                break
            x, y = int(column), int(row)
            block, code = (y // side) * columns + x // side, codes[y, x]
            if counts[0, block] == 0.0 and counts[1, block] == 0.0 and counts[2, block] == 0.0:
                touched[found] = block
                found += 1
                counts[2, block] = 1e-6
            if ended:
                if data[y, x] >= 0:
                    counts[0, block] += hits[code]
                    counts[1, block] += 1.0 - hits[code]
                break
            distance = distances[code]
            if distance == 0.0 and block != last_through:
                counts[1, block] += 1.0
                last_through = block
            elif block != last:
                counts[2, block] += 1.0
            last = block
            gone += max(0.7 * frame[3], min(distance - frame[3], 0.5 * side * frame[3]))
    return found


@kernel(
    "void(float32[:,::1], int64[::1], int64, boolean[::1], float64, float64, float64, float32[::1], float32[::1])"
)
def average_blocks(counts, touched, found, walled, news, enough, remembered, seen, unlike):
    """Update each touched block's averages with the counts of one scan; set the counts to zero again.

    Args:
        counts, touched: As `count_beams` leaves them.
        found: How many blocks were touched.
        walled: Whether the map has an occupied cell in a block, shape (blocks,).
        news: Weight of the scan, 0 to 1: how much of it is independent of earlier scans.
        enough: Beams of one scan in a block from which on more add no weight.
        remembered: Largest sum of weights: the averages forget beyond it.
        seen: Sum of the weights of scans that saw each block, shape (blocks,); changed.
        unlike: Weighted mean share of the beams that contradict the map, 0 to 1, shape (blocks,); changed.
    """
    for i in range(found):
        block = touched[i]
        told = counts[LIKE, block] + counts[UNLIKE, block]
        weight = told
        if told == 0.0 and not walled[block]:
            # A beam passing beside a mapped wall does not check it; in a block without walls it confirms free space.
            weight = counts[FREE, block]
        weight = news * min(1.0, weight / enough)
        now = counts[UNLIKE, block] / max(told, 1e-6)
        seen[block] = min(seen[block] + weight, remembered)
        unlike[block] += weight / max(seen[block], 1e-6) * (now - unlike[block])
        counts[LIKE, block], counts[UNLIKE, block], counts[FREE, block] = 0.0, 0.0, 0.0
