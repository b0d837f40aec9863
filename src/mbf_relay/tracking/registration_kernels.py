# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loop of laying a scan on the one before it."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_BASE = 0.08  # m between two readings of a wall from which on noise does not hide which way it runs
_WIDEST = 0.3  # m between them beyond which they are of two things
_ASIDE = 4  # readings to either side among which they are looked for


@kernel(
    "void(float64, float64, float64[::1], float64[:,::1], boolean[::1], float64, float64, float64[:,::1], boolean[::1],"
    " float64[::1], float64, float64, float64[:,::1])")
def pull(x, y, directions, points, solid, at_x, at_y, ends, hits, motion, gate, noise, system):
    """Sum up what pulls a scan on to the walls of the one before: by how far its readings lie off them.

    Args:
        x, y: Where the scan before was taken (m).
        directions, points, solid: Its directions (M,) in rising order (rad), where they end, (M, 2) in metres, and
            whether on something that stands.
        at_x, at_y: Where the scan was taken (m).
        ends, hits: Where its rays end, (N, 2) in metres, and whether anything was there.
        motion: Shape (3,): by how much it is moved (m) and turned (rad) about where it was taken.
        gate: Metres beyond which a reading is of something else.
        noise: Deviation (m) of a reading; those farther off count less (Cauchy).
        system: Shape (3, 4), written: the normal equations of the motion, and their right side.
    """
    count = directions.shape[0]
    system[:] = 0.0
    cos, sin = math.cos(motion[2]), math.sin(motion[2])
    row = np.empty(3)
    for n in range(ends.shape[0]):
        if not hits[n]:
            continue
        across, up = ends[n, 0] - at_x, ends[n, 1] - at_y
        turned_x, turned_y = cos * across - sin * up, sin * across + cos * up
        place_x, place_y = at_x + motion[0] + turned_x, at_y + motion[1] + turned_y
        bearing = math.atan2(place_y - y, place_x - x)
        low, high = 0, count
        while low < high:
            middle = (low + high) // 2
            if directions[middle] < bearing:
                low = middle + 1
            else:
                high = middle
        first, last = low - 1, low
        for _ in range(_ASIDE):
            dx = points[last % count, 0] - points[first % count, 0]
            dy = points[last % count, 1] - points[first % count, 1]
            if dx * dx + dy * dy >= _BASE * _BASE:
                break
            first, last = first - 1, last + 1
        length = math.hypot(dx, dy)
        if not (solid[first % count] and solid[last % count] and _BASE <= length <= _WIDEST):
            continue
        normal_x, normal_y = -dy / length, dx / length
        off = normal_x * (place_x - points[first % count, 0]) + normal_y * (place_y - points[first % count, 1])
        if abs(off) > gate:
            continue
        weight = 1.0 / (noise * noise + off * off)
        row[0], row[1], row[2] = normal_x, normal_y, normal_y * turned_x - normal_x * turned_y
        for i in range(3):
            for j in range(3):
                system[i, j] += weight * row[i] * row[j]
            system[i, 3] += weight * row[i] * off
