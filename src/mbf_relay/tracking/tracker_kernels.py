# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops of the tracker: prediction, association, correction, what was seen to be empty, scan laid on scan.

Things lie in one table, a row each; its columns are the module's names. Each loop does in the tracker's order what its
plain reference in the tests does with whole arrays, to the last bit.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

X, Y, VX, VY = 0, 1, 2, 3
POSITION, CROSS, VELOCITY = 4, 5, 6  # variances of position, position with velocity, velocity; alike for x and y
RADIUS, SEEN, BELIEF, NUMBER = 7, 8, 9, 10
COLUMNS = 11

_SEEN_EMPTY = 0.25  # share of its readings where there was nothing before, from which on a thing may have come there
_SURE = 1.0  # deviations of the velocity by which it must differ from zero: its place is the test that standing fails
_HALF_HIDDEN = 0.2  # of a scan: what standing still counts there; who passes behind something is soon out again
_IN_VIEW = 0.1  # rad between a direction and the beam that looked there
_BASE = 0.08  # m between two readings of a wall from which on noise does not hide which way it runs
_WIDEST = 0.3  # m between them beyond which they are of two things
_ASIDE = 4  # readings to either side among which they are looked for


@kernel("void(float64[:,::1], float64, float64, float64, float64, float64)")
def predict(things, elapsed, squared, position_noise, cross_noise, velocity_noise):
    """Move things on by constant velocity.

    Args:
        things: Shape (N, 11), changed.
        elapsed, squared: Seconds, and their square.
        position_noise, cross_noise, velocity_noise: What the acceleration adds to the variances meanwhile.
    """
    for n in range(things.shape[0]):
        position, cross, velocity = things[n, POSITION], things[n, CROSS], things[n, VELOCITY]
        things[n, X] += elapsed * things[n, VX]
        things[n, Y] += elapsed * things[n, VY]
        things[n, POSITION] = position + 2.0 * elapsed * cross + squared * velocity + position_noise
        things[n, CROSS] = cross + elapsed * velocity + cross_noise
        things[n, VELOCITY] = velocity + velocity_noise


@kernel("void(float64[:,::1], float64[:,::1], float64[::1], float64, float64, float64, int64[::1])")
def associate(things, discs, noises, gate, elapsed, convinced, taken):
    """Find for each cluster the thing it is: the nearest pairs first, by deviations; of pairs as near, the first.

    Args:
        things: Shape (N, 11).
        discs: Shape (K, 4): the clusters.
        noises: Shape (K,): variances (m^2) of their centres.
        gate: Squared deviations within which a cluster may be a thing.
        elapsed: Seconds since the last scan: who moved and turned back right after it is twice his way in them off.
        convinced: Belief from which on a thing moves.
        taken: Shape (K,), written: the thing, -1 for none.
    """
    count = discs.shape[0]
    taken[:] = -1
    near, distances = np.empty(64, np.int64), np.empty(64)
    pairs = 0
    for n in range(things.shape[0]):
        turned = 0.0
        if things[n, BELIEF] >= convinced:
            turned = 2.0 * elapsed * math.hypot(things[n, VX], things[n, VY])
        for k in range(count):
            across, up = things[n, X] - discs[k, 0], things[n, Y] - discs[k, 1]
            squared, total = across * across + up * up, things[n, POSITION] + noises[k]
            distance = squared / total
            if not (distance <= gate or squared <= (turned + math.sqrt(gate * total)) ** 2):
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


@kernel("void(float64[:,::1], float64[:,::1], float64[::1], int64[::1], float64, float64, float64, float64)")
def correct(things, discs, noises, taken, stamp, elapsed, surprise, convinced):
    """Take where things were seen, and how large.

    Args:
        things: Shape (N, 11), changed.
        discs, noises, taken: See `associate`; a disc's last column tells whether the whole of it was seen.
        stamp: Time (s).
        elapsed: Seconds since the last scan.
        surprise: Squared deviations from its place, as foreseen, from which on what moves has stopped or turned: its
            velocity is as uncertain then as it was high.
        convinced: Belief from which on a thing moves.
    """
    for k in range(discs.shape[0]):
        n = taken[k]
        if n < 0:
            continue
        position, cross, velocity = things[n, POSITION], things[n, CROSS], things[n, VELOCITY]
        total = position + noises[k]
        across, up = discs[k, 0] - things[n, X], discs[k, 1] - things[n, Y]
        if things[n, BELIEF] >= convinced and across * across + up * up > surprise * total:
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
        radius, seen_radius = things[n, RADIUS], discs[k, 2]
        if discs[k, 3] > 0.0:
            radius = radius + 0.3 * (seen_radius - radius)
        things[n, RADIUS] = max(radius, seen_radius)


@kernel("void(float64[::1], float64[::1], int64[::1], float64[::1], float64[::1])")
def arrange(bearings, ranges, order, directions, depths):
    """Sort a scan by its directions, each as deep as the least of it and its neighbours: an edge sees past itself.

    Args:
        bearings, ranges: Shape (N,): of the rays (rad, m).
        order: Shape (N,): what sorts the bearings.
        directions, depths: Shape (N,), written.
    """
    count = bearings.shape[0]
    for index in range(count):
        directions[index] = bearings[order[index]]
        depth = ranges[order[index]]
        depth = min(depth, ranges[order[index - 1]], ranges[order[(index + 1) % count]])
        depths[index] = depth


@kernel("int64(float64[::1], float64)")
def _first_not_below(directions, bearing):
    """Return the index of the first of rising directions (rad) that is not below a bearing; their number for none."""
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
    """Return the turn (rad) between two directions, of -pi to pi each."""
    turn = abs(one - other)
    return min(turn, 2.0 * math.pi - turn)


@kernel("boolean(float64, float64, float64, float64, float64[::1], float64[::1], float64, float64)")
def _sees_past(x, y, sensor_x, sensor_y, directions, depths, margin, aside):
    """Return whether a scan, see `arrange`, saw `margin` (m) beyond a point at least, and beyond all `aside` (m) of it.
    """
    across, up = x - sensor_x, y - sensor_y
    bearing, distance = math.atan2(up, across), math.hypot(across, up)
    count = directions.shape[0]
    nearest = _first_not_below(directions, bearing) % count
    if _turn(directions[nearest], bearing) >= _IN_VIEW or distance <= aside:
        return False
    width = math.asin(aside / distance)
    for way in (-1, 1):
        index = nearest
        for _ in range(count):
            if depths[index] <= distance + margin:
                return False
            index = (index + way) % count
            if _turn(directions[index], bearing) > width:
                break
    return True


@kernel(
    "void(float64[:,::1], float64[:,::1], int64[::1], float64[:,::1], int64[:,::1], int64[::1], float64, float64,"
    " float64[::1], float64[::1], float64, float64, float64[::1], float64[::1], float64, float64, float64, int64,"
    " int64, boolean[::1])")
def judge(
    things, discs, taken, ends, runs, order, x, y, directions, depths, other_x, other_y, other_directions, other_depths,
    slowest, margin, aside, convinced, most_convinced, moving,
):
    """Take what speaks for and against the moving of what was seen, and mark the readings of what moves.

    Args:
        things: Shape (N, 11), changed.
        discs, taken: See `correct`.
        ends: Shape (R, 2): where the scan's rays end (m).
        runs, order: The readings of cluster k are order[runs[k, 0]] to order[runs[k, 1] - 1].
        x, y, directions, depths: A scan of a while ago: where it was taken, and see `arrange`; empty for none.
        other_x, other_y, other_directions, other_depths: One of longer ago.
        slowest: Speed (m/s) below which nothing moves, as what does not differ from standing for sure.
        margin, aside: Metres beyond a reading, and to both sides of it, that must have been seen for its place to have
            been empty.
        convinced, most_convinced: Belief from which on a thing moves, and the highest there is.
        moving: Shape (R,), set where readings are of what moves.
    """
    for k in range(discs.shape[0]):
        n = taken[k]
        if n < 0:
            continue
        speed = math.hypot(things[n, VX], things[n, VY])
        is_fast = speed >= max(slowest, _SURE * math.sqrt(things[n, VELOCITY]))
        is_known = things[n, BELIEF] >= convinced  # it came once; one that nears slowly is seen to no more
        came = is_known
        first, last = runs[k, 0], runs[k, 1]
        if is_fast and not is_known:
            empty = 0
            for place in range(first, last):
                end_x, end_y = ends[order[place], 0], ends[order[place], 1]
                if (directions.shape[0] > 0 and _sees_past(end_x, end_y, x, y, directions, depths, margin, aside)) or (
                        other_directions.shape[0] > 0
                        and _sees_past(end_x, end_y, other_x, other_y, other_directions, other_depths, margin, aside)):
                    empty += 1
            came = empty / (last - first) >= _SEEN_EMPTY
        # half hidden, it seems to stand or to jump
        against = -_HALF_HIDDEN if is_known and not discs[k, 3] > 0.0 else -1.0
        belief = things[n, BELIEF] + (1.0 if is_fast and came else against)
        things[n, BELIEF] = min(np.float64(most_convinced), max(0.0, belief))
        if things[n, BELIEF] >= convinced:
            for place in range(first, last):
                moving[order[place]] = True


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
        last = _first_not_below(directions, bearing)
        first = last - 1
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


@kernel(
    "void(float64, float64, float64[::1], float64[:,::1], boolean[::1], float64, float64, float64[:,::1], boolean[::1],"
    " float64[::1], float64[::1], float64, float64[::1])")
def lay(x, y, directions, points, solid, at_x, at_y, ends, hits, prior, gates, noise, motion):
    """Find the motion that lays a scan on the one before, a step of Gauss and Newton for each gate.

    Args:
        x, y, directions, points, solid, at_x, at_y, ends, hits, noise: See `pull`.
        prior: Shape (3,): by how much that it did not move is believed, the inverse of its variances (1/m^2, 1/rad^2).
        gates: Shape (K,): metres beyond which a reading is of something else, of one step after the other.
        motion: Shape (3,), written: by how much it is moved (m) and turned (rad) about where it was taken.
    """
    system = np.empty((3, 4))
    motion[:] = 0.0
    for gate in gates:
        pull(x, y, directions, points, solid, at_x, at_y, ends, hits, motion, gate, noise, system)
        for i in range(3):
            system[i, i] += prior[i]
            system[i, 3] += prior[i] * motion[i]
        for i in range(3):  # by elimination; with the prior no diagonal is 0
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
