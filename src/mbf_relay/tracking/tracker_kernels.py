# mypy: allow-untyped-defs, allow-untyped-calls
"""Kernels of the tracker: prediction, association, correction, test of free space, scan matching.

The objects are the rows of one table, whose columns are named here. Each kernel gives the same result, bit by bit, as
its NumPy reference in the tests.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

X, Y, VX, VY = 0, 1, 2, 3
POSITION, CROSS, VELOCITY = 4, 5, 6  # variance of position, its covariance with velocity, variance of velocity
RADIUS, SEEN, BELIEF, NUMBER = 7, 8, 9, 10  # m; time (s) of the last cluster; see CONVINCED; track number
COLUMNS = 11

CONVINCED = 2.0  # belief (scans in favour of motion less those against) from which on an object counts as moving
_MOST_CONVINCED = 5.0  # largest belief
_GATE = 9.0  # squared Mahalanobis distance up to which a cluster is associated with an object
_SURPRISE = 3.0  # squared Mahalanobis distance from its prediction above which a moving object has stopped or turned
_DEPTH = 0.08  # m beyond a point that an earlier scan must have seen for the point to have been free
_ASIDE = 0.05  # m to both sides of the point that it must have seen past as well, as scans are not aligned exactly
_SEEN_EMPTY = 0.25  # share of an object's readings at places that were free before, from which on it has come there
_SURE = 1.0  # standard deviations by which a velocity must differ from zero; low, as free space is the stricter test
_HALF_HIDDEN = 0.2  # what a scan without motion counts against a moving object that is partly occluded
_RADIUS_SHARE = 0.3  # by which a radius follows the one that is seen whole; two side by side are seen as one at times
_IN_VIEW = 0.1  # rad, largest angle between a direction and the nearest beam for which that direction was in view
_BASE = 0.08  # m, least distance of two readings of a wall that define its direction in spite of noise
_WIDEST = 0.3  # m, largest distance between them; farther apart they may belong to two objects
_TRIES = 4  # readings to either side among which they are searched


@kernel("void(float64[:,::1], float64, float64, float64, float64, float64)")
def predict(things, elapsed, squared, position_noise, cross_noise, velocity_noise):
    """Predict objects by constant velocity.

    Args:
        things: The objects, shape (N, 11), changed.
        elapsed, squared: Time step (s), and its square.
        position_noise, cross_noise, velocity_noise: Process noise of the step, from a random acceleration.
    """
    for n in range(things.shape[0]):
        position, cross, velocity = things[n, POSITION], things[n, CROSS], things[n, VELOCITY]
        things[n, X] += elapsed * things[n, VX]
        things[n, Y] += elapsed * things[n, VY]
        things[n, POSITION] = position + 2.0 * elapsed * cross + squared * velocity + position_noise
        things[n, CROSS] = cross + elapsed * velocity + cross_noise
        things[n, VELOCITY] = velocity + velocity_noise


@kernel("void(float64[:,::1], float64[:,::1], float64[::1], float64, int64[::1])")
def associate(things, discs, noises, elapsed, taken):
    """Associate clusters with objects, greedily by rising Mahalanobis distance; of equal pairs, the first.

    Args:
        things: The objects, shape (N, 11).
        discs: The clusters, shape (K, 4).
        noises: Variances (m^2) of their centres, shape (K,).
        elapsed: Time since the last scan (s). The gate of a moving object is wider by twice its way in that time, which
            is how far it is off its prediction if it has turned back.
        taken: Written: the object of each cluster, -1 for none, shape (K,).
    """
    count = discs.shape[0]
    taken[:] = -1
    near, distances = np.empty(64, np.int64), np.empty(64)
    pairs = 0
    for n in range(things.shape[0]):
        turned = 0.0
        if things[n, BELIEF] >= CONVINCED:
            turned = 2.0 * elapsed * math.hypot(things[n, VX], things[n, VY])
        for k in range(count):
            across, up = things[n, X] - discs[k, 0], things[n, Y] - discs[k, 1]
            squared, total = across * across + up * up, things[n, POSITION] + noises[k]
            distance = squared / total
            if not (distance <= _GATE or squared <= (turned + math.sqrt(_GATE * total)) ** 2):
                continue
            if pairs == near.shape[0]:
                near, distances = np.append(near, np.empty_like(near)), np.append(distances, np.empty_like(distances))
            place = pairs
            while place > 0 and distances[place - 1] > distance:
                near[place], distances[place] = near[place - 1], distances[place - 1]
                place -= 1
            near[place], distances[place] = n * count + k, distance
            pairs += 1
    free = np.ones(things.shape[0], np.bool_)
    for index in range(pairs):
        n, k = near[index] // count, near[index] % count
        if free[n] and taken[k] < 0:
            taken[k] = n
            free[n] = False


@kernel("void(float64[:,::1], float64[:,::1], float64[::1], int64[::1], float64, float64)")
def correct(things, discs, noises, taken, stamp, elapsed):
    """Update the objects' states and radii by their clusters.

    Where a moving object has stopped or turned, the variance of its velocity is first raised by its squared speed.

    Args:
        things: The objects, shape (N, 11), changed.
        discs, noises, taken: See `associate`; a disc's last column is 0 where it is partly occluded.
        stamp: Time (s).
        elapsed: Time since the last scan (s).
    """
    for k in range(discs.shape[0]):
        n = taken[k]
        if n < 0:
            continue
        position, cross, velocity = things[n, POSITION], things[n, CROSS], things[n, VELOCITY]
        total = position + noises[k]
        across, up = discs[k, 0] - things[n, X], discs[k, 1] - things[n, Y]
        if things[n, BELIEF] >= CONVINCED and across * across + up * up > _SURPRISE * total:
            turned = things[n, VX] * things[n, VX] + things[n, VY] * things[n, VY]
            position += elapsed * elapsed * turned
            cross += elapsed * turned
            velocity += turned
            total = position + noises[k]
        things[n, X] += position / total * across
        things[n, Y] += position / total * up
        things[n, VX] += cross / total * across
        things[n, VY] += cross / total * up
        things[n, POSITION] = position - position * position / total
        things[n, CROSS] = cross - position * cross / total
        things[n, VELOCITY] = velocity - cross * cross / total
        things[n, SEEN] = stamp
        if discs[k, 3] > 0.0:
            things[n, RADIUS] += _RADIUS_SHARE * (discs[k, 2] - things[n, RADIUS])
        else:  # of what is partly hidden, the whole is at least as wide
            things[n, RADIUS] = max(things[n, RADIUS], discs[k, 2])


@kernel("void(float64[::1], float64[::1], int64[::1], float64[::1], float64[::1])")
def arrange(bearings, ranges, order, directions, depths):
    """Sort a scan by direction, with each depth the minimum over the ray and its neighbours.

    The minimum, because a ray that just misses an edge does not show that the place beside it is free.

    Args:
        bearings, ranges: Directions (rad) and ranges (m) of the rays, shape (N,).
        order: Indices that sort the bearings, shape (N,).
        directions, depths: Written: directions (rad), rising, and depths (m), shape (N,).
    """
    count = bearings.shape[0]
    for index in range(count):
        directions[index] = bearings[order[index]]
        depth = ranges[order[index]]
        depth = min(depth, ranges[order[index - 1]], ranges[order[(index + 1) % count]])
        depths[index] = depth


@kernel("int64(float64[::1], float64)")
def _first_not_below(directions, bearing):
    """Return the index of the first of rising directions (rad) not below a bearing, by bisection; their number if none.
    """
    low, high = 0, directions.shape[0]
    while low < high:
        middle = (low + high) // 2
        if directions[middle] < bearing:
            low = middle + 1
        else:
            high = middle
    return low


@kernel("float64(float64, float64)")
def _turn(one, other):
    """Return the absolute angle (rad) between two directions in -pi to pi."""
    turn = abs(one - other)
    return min(turn, 2.0 * math.pi - turn)


@kernel("boolean(float64, float64, float64, float64, float64[::1], float64[::1])")
def _sees_past(x, y, sensor_x, sensor_y, directions, depths):
    """Return whether a scan saw a point as free: beyond it by _DEPTH, and within _ASIDE to both sides.

    Args:
        x, y: The point (m).
        sensor_x, sensor_y: Position of the sensor (m).
        directions, depths: The scan, of one ray at least; see `arrange`.
    """
    across, up = x - sensor_x, y - sensor_y
    bearing, distance = math.atan2(up, across), math.hypot(across, up)
    count = directions.shape[0]
    nearest = _first_not_below(directions, bearing) % count
    if _turn(directions[nearest], bearing) >= _IN_VIEW or distance <= _ASIDE:
        return False
    width = math.asin(_ASIDE / distance)
    for way in (-1, 1):
        index = nearest
        for _ in range(count):
            if depths[index] <= distance + _DEPTH:
                return False
            index = (index + way) % count
            if _turn(directions[index], bearing) > width:
                break
    return True


@kernel("void(float64, float64, float64[::1], float64[::1], float64[:,::1], boolean[::1])")
def mark_free(x, y, directions, depths, ends, was_free):
    """Mark the points that an earlier scan saw as free.

    Args:
        x, y, directions, depths: The scan: position of the sensor (m), and see `arrange`; empty for none.
        ends: The points (m), shape (R, 2).
        was_free: Set to True for these points, shape (R,).
    """
    if directions.shape[0] == 0:
        return
    for n in range(ends.shape[0]):
        if not was_free[n]:
            was_free[n] = _sees_past(ends[n, 0], ends[n, 1], x, y, directions, depths)


@kernel(
    "void(float64[:,::1], float64[:,::1], int64[::1], int64[:,::1], int64[::1], boolean[::1], float64, boolean[::1])")
def update_beliefs(things, discs, taken, runs, order, was_free, slowest, moving):
    """Update the objects' belief to move, and mark the readings of moving objects.

    Args:
        things: The objects, shape (N, 11), changed.
        discs, taken: See `correct`.
        runs, order: The readings of cluster k are order[runs[k, 0]] to order[runs[k, 1] - 1].
        was_free: Which readings of the scan are at places that an earlier scan saw as free, shape (R,).
        slowest: Speed (m/s) below which an object does not move.
        moving: Set to True for readings of moving objects, shape (R,).
    """
    for k in range(discs.shape[0]):
        n = taken[k]
        if n < 0:
            continue
        readings = order[runs[k, 0]:runs[k, 1]]
        speed = math.hypot(things[n, VX], things[n, VY])
        is_fast = speed >= max(slowest, _SURE * math.sqrt(things[n, VELOCITY]))
        is_known = things[n, BELIEF] >= CONVINCED  # not tested again: one that comes slowly nearer would fail
        free = 0
        for reading in readings:
            free += was_free[reading]
        came = is_known or free / readings.shape[0] >= _SEEN_EMPTY
        # a partly occluded object seems to stand or to jump
        against = -_HALF_HIDDEN if is_known and not discs[k, 3] > 0.0 else -1.0
        belief = things[n, BELIEF] + (1.0 if is_fast and came else against)
        things[n, BELIEF] = min(_MOST_CONVINCED, max(0.0, belief))
        if things[n, BELIEF] >= CONVINCED:
            for reading in readings:
                moving[reading] = True


@kernel(
    "void(float64, float64, float64[::1], float64[:,::1], boolean[::1], float64, float64, float64[:,::1], boolean[::1],"
    " float64[::1], float64, float64, float64[:,::1])")
def normal_equations(x, y, directions, points, solid, at_x, at_y, ends, hits, motion, gate, noise, system):
    """Set up the normal equations of a point-to-line scan matching step.

    Each reading is compared with the line through two readings of the scan before, next to its direction.

    Args:
        x, y: Position of the scan before (m).
        directions, points, solid: Its directions (rad) in rising order, shape (M,), its end points (m), shape (M, 2),
            and which of them are on standing objects, shape (M,).
        at_x, at_y: Position of the scan (m).
        ends, hits: Its end points (m), shape (N, 2), and which rays hit something, shape (N,).
        motion: The present correction: translation (m) and rotation (rad) about the scan's position, shape (3,).
        gate: Largest distance (m) between a reading and its line.
        noise: Standard deviation (m) of a reading; larger distances have smaller weights (Cauchy).
        system: Written: the matrix and the right side of the normal equations, shape (3, 4).
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
        last = _first_not_below(directions, bearing)
        first = last - 1
        for _ in range(_TRIES):
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


@kernel(
    "void(float64, float64, float64[::1], float64[:,::1], boolean[::1], float64, float64, float64[:,::1], boolean[::1],"
    " float64[::1], float64[::1], float64, float64[::1])")
def match_scan(x, y, directions, points, solid, at_x, at_y, ends, hits, prior, gates, noise, motion):
    """Match a scan with the one before, by a Gauss-Newton step for each gate.

    Args:
        x, y, directions, points, solid, at_x, at_y, ends, hits, noise: See `normal_equations`.
        prior: Inverse variances of the correction, whose mean is zero (1/m^2, 1/m^2, 1/rad^2), shape (3,).
        gates: Largest distance (m) between a reading and its line in each step, shape (K,).
        motion: Written: translation (m) and rotation (rad) about the scan's position, shape (3,).
    """
    system = np.empty((3, 4))
    motion[:] = 0.0
    for gate in gates:
        normal_equations(x, y, directions, points, solid, at_x, at_y, ends, hits, motion, gate, noise, system)
        for i in range(3):
            system[i, i] += prior[i]
            system[i, 3] += prior[i] * motion[i]
        for i in range(3):  # Gaussian elimination; with the prior, no pivot is 0
            for j in range(i + 1, 3):
                share = system[j, i] / system[i, i]
                for k in range(i, 4):
                    system[j, k] -= share * system[i, k]
        for i in range(2, -1, -1):
            for j in range(i + 1, 3):
                system[i, 3] -= system[i, j] * system[j, 3]
            system[i, 3] /= system[i, i]
        for i in range(3):
            motion[i] -= system[i, 3]
