# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops that know which way the faces of walls look: who is behind one does not see it."""

from __future__ import annotations

import math

from mbf_relay.kernels import kernel

NEAR = 3
"""Cells from a face within which a beam's end is taken to be on it."""
LOOKS, THIN = 7, 8
"""Ways a face can look, where 0 stands for both, or for none being near; and what is added where the wall is thin."""
ONE_WAY = 1.5
"""Length of the sum of the ways to the free cells round a face from which it looks one way."""
FROM_BEHIND = 0.5
"""Cosine between a beam's way and the face's from which it came from behind, however that is rounded."""


@kernel("void(uint8[:,::1], uint8[:,::1], int64, uint8[:,::1], uint8[:,::1])")
def look_around(faces, free, thin, looks, nearest):
    """Tell which way the face looks that is nearest to each cell.

    A face looks to where the cells round it are free: one of a wall of a single cell, or of the leg of a table, both
    ways.

    Args:
        faces: Which cells hold an obstacle's face, shape (H, W).
        free: Which cells are free, shape (H, W).
        thin: Cells, at most, behind the face of a thin wall until there is free space again.
        looks: Result, shape (H, W), zeros at first: 1 to LOOKS, from -pi on in even steps, THIN added for a thin wall;
            0 within NEAR cells of no face, or where that looks both ways.
        nearest: Shape (H, W), 255 at first: the square of the distance (cells).
    """
    height, width = faces.shape
    for y in range(height):
        for x in range(width):
            if faces[y, x] == 0:
                continue
            to_x = to_y = 0.0
            for v in range(max(y - 1, 0), min(y + 2, height)):
                for u in range(max(x - 1, 0), min(x + 2, width)):
                    if free[v, u] != 0:
                        share = 1.0 / math.sqrt(float((u - x) * (u - x) + (v - y) * (v - y)))
                        to_x += (u - x) * share
                        to_y += (v - y) * share
            look = 0
            length = math.hypot(to_x, to_y)
            if length > ONE_WAY:
                look = 1 + int((math.atan2(to_y, to_x) + math.pi) / (2.0 * math.pi) * LOOKS) % LOOKS
                for k in range(1, thin + 1):
                    u, v = int(round(x - k * to_x / length)), int(round(y - k * to_y / length))
                    if 0 <= u < width and 0 <= v < height and free[v, u] != 0:
                        look += THIN
                        break
            for v in range(max(y - NEAR, 0), min(y + NEAR + 1, height)):
                for u in range(max(x - NEAR, 0), min(x + NEAR + 1, width)):
                    far = (u - x) * (u - x) + (v - y) * (v - y)
                    if far <= NEAR * NEAR and far < nearest[v, u]:
                        nearest[v, u], looks[v, u] = far, look


@kernel(
    "void(float64[:,::1], float64[:,::1], uint16[:,::1], int64, boolean, float64[::1], float32[::1], float64, "
    "float64[::1])"
)
def credit_from_behind(poses, endpoints, codes, shift, thin_too, frame, table, outside, sums):
    """Add up what beams have to their credit that end on a face they cannot have seen: it looks the other way.

    Args:
        poses: Shape (N, 3), in the map's frame.
        endpoints: Shape (B, 2) in metres, in the base's frame, where beams come from but for the lidar's own place.
        codes: Of the distance field, shape (height, width).
        shift: Bits of a code below those that tell how the nearest face looks.
        thin_too: Whether also faces of thin walls are looked at.
        frame: Origin x, y, theta and resolution of the map, shape (4,).
        table: The term of a beam that ends in a cell, for each code.
        outside: The term of a beam that ends far from all.
        sums: Result, shape (N,): of table - outside over those beams.
    """
    height, width = codes.shape
    cos_origin, sin_origin = math.cos(frame[2]), math.sin(frame[2])
    scale, step = 1.0 / frame[3], 2.0 * math.pi / LOOKS
    for i in range(poses.shape[0]):
        dx, dy = poses[i, 0] - frame[0], poses[i, 1] - frame[1]
        column0, row0 = (cos_origin * dx + sin_origin * dy) * scale, (cos_origin * dy - sin_origin * dx) * scale
        cos, sin = math.cos(poses[i, 2] - frame[2]), math.sin(poses[i, 2] - frame[2])
        total = 0.0
        for j in range(endpoints.shape[0]):
            arm_x = cos * endpoints[j, 0] - sin * endpoints[j, 1]
            arm_y = sin * endpoints[j, 0] + cos * endpoints[j, 1]
            column, row = column0 + scale * arm_x, row0 + scale * arm_y
            if not (column >= 0.0 and row >= 0.0 and column < width and row < height):
                continue
            code = codes[int(row), int(column)]
            look = (code >> shift) & LOOKS
            if look != 0 and (thin_too or (code >> shift) & THIN == 0):
                angle = (look - 0.5) * step - math.pi
                if math.cos(angle) * arm_x + math.sin(angle) * arm_y > FROM_BEHIND * math.hypot(arm_x, arm_y):
                    total += table[code] - outside
        sums[i] = total
