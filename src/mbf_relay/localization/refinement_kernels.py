# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops of scan matching: poses are refined to where a scan fits the distance field."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

FREE_TO = 25
"""Occupancy up to which a cell of a map is free."""
OCCUPIED = 1 << 15
"""Added to the distance field's code of an occupied cell; below it are the distances."""
LONGEST_STEP = 0.2
"""Upper bound (m) of one Gauss-Newton step."""
LARGEST_TURN = 0.1
"""Upper bound (rad) of the turn in one Gauss-Newton step."""
NEAR = 3
"""Distance (cells) from a beam's end up to which a face cell is taken for the one it hit."""
ONE_WAY, FROM_BEHIND = 1.5, 0.3
"""Length of the sum of unit vectors from a face cell to its free neighbours above which it faces one way, and cosine
between that sum and a beam above which the beam comes from behind."""
DISTANCE = OCCUPIED - 1
"""Bits of the distance field's codes with the distance; it is 0 in face cells."""


@kernel("int64(float64[:,::1], int64[::1], int64, float64, float64, int64[::1])")
def choose_apart(poses, order, count, distance, turn, chosen):
    """Choose up to `count` poses in order, none within `distance` (m) and `turn` (rad) of an earlier one.

    Args:
        poses: Shape (N, 3).
        order: Indices of the poses to consider, best first.
        count, distance, turn: See above.
        chosen: Result, room for `count` indices.

    Returns:
        How many were chosen.
    """
    found = 0
    for n in range(order.shape[0]):
        if found >= count:
            break
        i, near = order[n], False
        for k in range(found):
            other = chosen[k]
            dx, dy = poses[i, 0] - poses[other, 0], poses[i, 1] - poses[other, 1]
            if dx * dx + dy * dy <= distance * distance:
                turned = poses[i, 2] - poses[other, 2]
                turned -= 2.0 * math.pi * math.floor((turned + math.pi) / (2.0 * math.pi))
                if abs(turned) <= turn:
                    near = True
                    break
        if not near:
            chosen[found] = i
            found += 1
    return found


@kernel("boolean(float64[:,::1], float64[:,::1])")
def invert(matrix, inverse):
    """Invert a symmetric 3 x 3 matrix; return whether it has an inverse."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    inverse[0, 0], inverse[0, 1], inverse[0, 2] = d * f - e * e, c * e - b * f, b * e - c * d
    inverse[1, 1], inverse[1, 2], inverse[2, 2] = a * f - c * c, b * c - a * e, a * d - b * b
    inverse[1, 0], inverse[2, 0], inverse[2, 1] = inverse[0, 1], inverse[0, 2], inverse[1, 2]
    determinant = a * inverse[0, 0] + b * inverse[0, 1] + c * inverse[0, 2]
    if not abs(determinant) > 1e-300:
        return False
    for i in range(3):
        for j in range(3):
            inverse[i, j] /= determinant
    return True


@kernel(
    "float64(float64[::1], float64[:,::1], uint16[:,::1], float32[::1], float64[::1], float64, float64, "
    "float64[:,::1], float64[::1])"
)
def linearize(pose, endpoints, codes, distances, frame, sigma, outlier, information, gradient):
    """Build the normal equations of a scan against the distance field at one pose.

    Each beam is weighted by the probability that it hit a mapped obstacle and not something else, which is the
    expectation step for the mixture (1 - outlier) exp(-d^2 / 2 sigma^2) + outlier.

    Args:
        pose: Shape (3,), in the map's frame.
        endpoints: Shape (B, 2) in the base's frame.
        codes: Of the distance field, shape (height, width).
        distances: To the nearest face (m), for each code.
        frame: Origin x, y, theta and resolution of the map, shape (4,).
        sigma: Standard deviation (m) of a hit.
        outlier: Share of beams that hit something else.
        information: Result, shape (3, 3): sum of w J^T J / sigma^2.
        gradient: Result, shape (3,): sum of w J^T d / sigma^2.

    Returns:
        The sum of the beams' probabilities of a hit.
    """
    height, width = codes.shape
    cos_origin, sin_origin = math.cos(frame[2]), math.sin(frame[2])
    scale = 1.0 / frame[3]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    precision = 1.0 / (sigma * sigma)
    information[:, :] = 0.0
    gradient[:] = 0.0
    explained = 0.0
    for j in range(endpoints.shape[0]):
        arm_x = cos * endpoints[j, 0] - sin * endpoints[j, 1]
        arm_y = sin * endpoints[j, 0] + cos * endpoints[j, 1]
        dx, dy = pose[0] + arm_x - frame[0], pose[1] + arm_y - frame[1]
        column = (cos_origin * dx + sin_origin * dy) * scale - 0.5
        row = (cos_origin * dy - sin_origin * dx) * scale - 0.5
        if not (column >= 0.0 and row >= 0.0 and column < width - 1 and row < height - 1):
            continue
        x, y = int(column), int(row)
        u, v = column - x, row - y
        d00, d10 = distances[codes[y, x]], distances[codes[y, x + 1]]
        d01, d11 = distances[codes[y + 1, x]], distances[codes[y + 1, x + 1]]
        distance = (1 - v) * ((1 - u) * d00 + u * d10) + v * ((1 - u) * d01 + u * d11)
        hit = (1.0 - outlier) * math.exp(-0.5 * distance * distance * precision)
        weight = hit / (hit + outlier)
        explained += weight
        slope_u = ((1 - v) * (d10 - d00) + v * (d11 - d01)) * scale
        slope_v = ((1 - u) * (d01 - d00) + u * (d11 - d10)) * scale
        jx = cos_origin * slope_u - sin_origin * slope_v
        jy = sin_origin * slope_u + cos_origin * slope_v
        ja = jy * arm_x - jx * arm_y
        factor = weight * precision
        information[0, 0] += factor * jx * jx
        information[0, 1] += factor * jx * jy
        information[0, 2] += factor * jx * ja
        information[1, 1] += factor * jy * jy
        information[1, 2] += factor * jy * ja
        information[2, 2] += factor * ja * ja
        gradient[0] += factor * jx * distance
        gradient[1] += factor * jy * distance
        gradient[2] += factor * ja * distance
    information[1, 0], information[2, 0], information[2, 1] = information[0, 1], information[0, 2], information[1, 2]
    return explained


@kernel(
    "void(float64[:,::1], float64[:,::1], uint16[:,::1], float32[::1], float64[::1], float64[::1], float64, float64,"
    " float64[::1], float64[:,::1], int64, float64[:,:,::1], float64[::1])"
)
def climb(
    poses, endpoints, codes, distances, frame, sigmas, outlier, temper, prior_mean, prior_information, iterations,
    covariances, explained,
):
    """Move each pose to the nearest maximum of prior times tempered scan likelihood, by Gauss-Newton steps.

    Directions that the scan does not determine, e.g. along a bare corridor, stay as in the prior.

    Args:
        poses: Start poses, shape (K, 3), overwritten by the maxima, with headings in [-pi, pi).
        endpoints, codes, distances, frame, outlier: As for `linearize`.
        sigmas: Standard deviations (m) of a hit, used one after the other, wide to narrow, shape (S,).
        temper: Factor on the scan's log-likelihood.
        prior_mean, prior_information: Of the one prior of all poses, shapes (3,) and (3, 3).
        iterations: Steps at each deviation.
        covariances: Result, shape (K, 3, 3): inverse curvature at each maximum.
        explained: Result, shape (K,): share of the beams the map explains there.
    """
    information, inverse = np.empty((3, 3)), np.empty((3, 3))
    gradient = np.empty(3)
    for k in range(poses.shape[0]):
        pose = poses[k]
        for level in range(sigmas.shape[0]):
            for _ in range(iterations):
                linearize(pose, endpoints, codes, distances, frame, sigmas[level], outlier, information, gradient)
                turn = pose[2] - prior_mean[2]
                turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
                dx, dy = pose[0] - prior_mean[0], pose[1] - prior_mean[1]
                for i in range(3):
                    pull = prior_information[i, 0] * dx + prior_information[i, 1] * dy + prior_information[i, 2] * turn
                    gradient[i] = temper * gradient[i] + pull
                    for j in range(3):
                        information[i, j] = temper * information[i, j] + prior_information[i, j]
                if not invert(information, inverse):
                    break
                step_x = -(inverse[0, 0] * gradient[0] + inverse[0, 1] * gradient[1] + inverse[0, 2] * gradient[2])
                step_y = -(inverse[1, 0] * gradient[0] + inverse[1, 1] * gradient[1] + inverse[1, 2] * gradient[2])
                step_a = -(inverse[2, 0] * gradient[0] + inverse[2, 1] * gradient[1] + inverse[2, 2] * gradient[2])
                longest = max(math.hypot(step_x, step_y) / LONGEST_STEP, abs(step_a) / LARGEST_TURN, 1.0)
                pose[0] += step_x / longest
                pose[1] += step_y / longest
                pose[2] += step_a / longest
                if math.hypot(step_x, step_y) < 1e-4 and abs(step_a) < 1e-4:
                    break
        last = sigmas[sigmas.shape[0] - 1]
        hits = linearize(pose, endpoints, codes, distances, frame, last, outlier, information, gradient)
        explained[k] = hits / max(1, endpoints.shape[0])
        for i in range(3):
            for j in range(3):
                information[i, j] = temper * information[i, j] + prior_information[i, j]
        invert(information, covariances[k])
        pose[2] = (pose[2] + math.pi) % (2.0 * math.pi) - math.pi


@kernel(
    "void(float64[:,::1], float64[:,::1], uint16[:,::1], int8[:,::1], float64[::1], float32[::1], float64, "
    "float64[::1])"
)
def credit_from_behind(poses, endpoints, codes, occupancy, frame, table, outside, sums):
    """Sum for each pose the terms of the beams that end on a face which looks away from the lidar.

    A face looks towards its free neighbours. That of a wall one cell thick, or of a table's leg, looks both ways.

    Args:
        poses: Shape (K, 3), in the map's frame.
        endpoints: Shape (B, 2) in metres, in the base's frame; beams are taken to come from the base.
        codes: Of the distance field, shape (height, width).
        occupancy: The map, shape (height, width).
        frame: Origin x, y, theta and resolution of the map, shape (4,).
        table: The term of a beam that ends in a cell, for each code.
        outside: The term of a beam that ends far from all.
        sums: Result, shape (K,): of table - outside over those beams.
    """
    height, width = codes.shape
    cos_origin, sin_origin = math.cos(frame[2]), math.sin(frame[2])
    scale = 1.0 / frame[3]
    for k in range(poses.shape[0]):
        dx, dy = poses[k, 0] - frame[0], poses[k, 1] - frame[1]
        column0, row0 = (cos_origin * dx + sin_origin * dy) * scale, (cos_origin * dy - sin_origin * dx) * scale
        cos, sin = math.cos(poses[k, 2] - frame[2]), math.sin(poses[k, 2] - frame[2])
        sums[k] = 0.0
        for j in range(endpoints.shape[0]):
            arm_x = cos * endpoints[j, 0] - sin * endpoints[j, 1]
            arm_y = sin * endpoints[j, 0] + cos * endpoints[j, 1]
            column, row = column0 + scale * arm_x, row0 + scale * arm_y
            margin = NEAR + 1.0
            if not (column >= margin and row >= margin and column < width - margin and row < height - margin):
                continue
            x, y = int(column), int(row)
            nearest, face_x, face_y = NEAR * NEAR + 1, 0, 0
            for v in range(-NEAR, NEAR + 1):
                for u in range(-NEAR, NEAR + 1):
                    if u * u + v * v < nearest and codes[y + v, x + u] & DISTANCE == 0:
                        nearest, face_x, face_y = u * u + v * v, x + u, y + v
            if nearest > NEAR * NEAR:
                continue
            look_x = look_y = 0.0
            for v in range(-1, 2):
                for u in range(-1, 2):
                    if (u != 0 or v != 0) and 0 <= occupancy[face_y + v, face_x + u] <= FREE_TO:
                        share = 1.0 / math.sqrt(float(u * u + v * v))
                        look_x += u * share
                        look_y += v * share
            look, way = math.hypot(look_x, look_y), math.hypot(arm_x, arm_y)
            if look > ONE_WAY and look_x * arm_x + look_y * arm_y > FROM_BEHIND * look * way:
                sums[k] += table[codes[y, x]] - outside
