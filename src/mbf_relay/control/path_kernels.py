# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over paths: thinning, and the nearest point of a polyline for many points at once."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_STRETCH = 8  # segments of a path that `project` skips together


@kernel("void(float64[:,::1], float64, uint8[::1])")
def thin(points, spacing, keep):
    """Mark the points of a path that lie at least `spacing` from the last one marked, and the final one.

    Args:
        points: Shape (N, 2) in metres, N >= 1.
        spacing: Metres.
        keep: Shape (N,), filled with 0 and 1; points that repeat the final one are not kept besides it.
    """
    last = points.shape[0] - 1
    keep[:] = 0
    keep[0] = 1
    kept = 0
    for index in range(1, points.shape[0]):
        if math.hypot(points[index, 0] - points[kept, 0], points[index, 1] - points[kept, 1]) >= spacing:
            keep[index] = 1
            kept = index
    if kept == last:
        return
    if kept > 0 or (points[0, 0] == points[last, 0] and points[0, 1] == points[last, 1]):
        keep[kept] = 0
    keep[last] = 1


@kernel("void(float64[:,::1], float64[::1])")
def measure(points, arcs):
    """Fill `arcs`, shape (N,), with the arc length (m) at each of `points`, (N, 2)."""
    arcs[0] = 0.0
    for n in range(1, points.shape[0]):
        arcs[n] = arcs[n - 1] + math.hypot(points[n, 0] - points[n - 1, 0], points[n, 1] - points[n - 1, 1])


@kernel("void(float64[:,::1], float64, float64[:,::1])")
def look_ahead(poses, way, points):
    """Fill `points`, shape (N, 2), with the points `way` (m) ahead of each of `poses`, shape (N, 3)."""
    for n in range(poses.shape[0]):
        points[n, 0], points[n, 1] = poses[n, 0], poses[n, 1]
        if way != 0.0:
            points[n, 0] += way * math.cos(poses[n, 2])
            points[n, 1] += way * math.sin(poses[n, 2])


@kernel("int64(float64[:,::1], float64, float64, float64, float64, float64)")
def first_near(poses, x, y, theta, apart, turn):
    """Return the index of the first of `poses` near another one; -1 where none is.

    Args:
        poses: Shape (N, 3 or more): x, y (m), theta (rad) in its first columns.
        x, y, theta: The other pose.
        apart, turn: Distance (m) and angle (rad) below which they are near.
    """
    for n in range(poses.shape[0]):
        dx, dy = poses[n, 0] - x, poses[n, 1] - y
        if abs(dx) < apart and abs(dy) < apart and math.hypot(dx, dy) < apart:
            if abs((poses[n, 2] - theta + math.pi) % (2.0 * math.pi) - math.pi) < turn:
                return n
    return -1


@kernel("float64(float64, int64, float64[::1], float64[:,::1], int64)")
def _beyond(place, low, places, values, column):
    """Return `interpolate` for a place whose last index not beyond it, `low`, is known."""
    if places[low] == place or low == places.shape[0] - 1:
        return values[low, column]
    slope = (values[low + 1, column] - values[low, column]) / (places[low + 1] - places[low])
    return slope * (place - places[low]) + values[low, column]


@kernel("float64(float64, float64[::1], float64[:,::1], int64)")
def interpolate(place, places, values, column):
    """Return a column of `values`, shape (N, 2), where `place` lies among rising `places`, as numpy.interp does."""
    last = places.shape[0] - 1
    if place <= places[0]:
        return values[0, column]
    if place >= places[last]:
        return values[last, column]
    low, high = 0, last
    while high - low > 1:
        middle = (low + high) // 2
        if places[middle] <= place:
            low = middle
        else:
            high = middle
    return _beyond(place, low, places, values, column)


@kernel("int64(float64[:,::1], float64[::1], float64, int64[::1], float64[::1])")
def compare_legs(points, arcs, leg, inner, products):
    """Compare the ways that lead to and from each inner point of a path; return the number of inner points.

    Args:
        points: Shape (N, 2) in metres.
        arcs: Shape (N,): arc length (m) at each of them.
        leg: Length (m) of these ways along the path; inner points are as far from both ends.
        inner: Shape (N,), filled from the front with the indices of the inner points.
        products: Shape (N,), filled from the front with the inner product (m^2) of the two ways at each.
    """
    last, count, behind, ahead = points.shape[0] - 1, 0, 0, 0
    for n in range(last + 1):
        if not leg <= arcs[n] <= arcs[last] - leg:
            continue
        while behind < last and arcs[behind + 1] <= arcs[n] - leg:
            behind += 1
        while ahead < last and arcs[ahead + 1] <= arcs[n] + leg:
            ahead += 1
        product = 0.0
        for axis in range(2):
            before = _beyond(arcs[n] - leg, behind, arcs, points, axis)
            after = _beyond(arcs[n] + leg, ahead, arcs, points, axis)
            product += (points[n, axis] - before) * (after - points[n, axis])
        inner[count], products[count] = n, product
        count += 1
    return count


@kernel("int64(float64[:,::1], float64[::1], float64, int64, float64[:,::1])")
def smooth(points, arcs, spacing, reach, result):
    """Resample a path and average each point with `reach` points on either side; return the number of points.

    The ends stay, because the path is continued beyond them by point reflection. With less than five points nothing
    is done, and 0 returned.

    Args:
        points: Shape (N, 2) in metres.
        arcs: Shape (N,): arc length (m) at each of them.
        spacing: Distance (m) between points of the result.
        reach: Points on either side, 1 to 3.
        result: Shape (M, 2), filled from the front; M is arcs[-1] / spacing and 1 more, or larger.
    """
    end = arcs[-1]
    count = int(end / spacing)
    if count < 4:
        return 0
    step = end / count
    width = 2 * reach + 1
    for column in range(2):
        line = np.empty(count + 1 + 2 * reach)
        for n in range(count + 1):
            line[reach + n] = interpolate(end if n == count else n * step, arcs, points, column)
        first, last = line[reach], line[reach + count]
        for n in range(1, reach + 1):
            line[reach - n] = 2.0 * first - line[reach + n]
            line[reach + count + n] = 2.0 * last - line[reach + count - n]
        sums = np.empty(line.shape[0] + 1)
        sums[0] = 0.0
        for n in range(line.shape[0]):
            sums[n + 1] = sums[n] + line[n]
        for n in range(count + 1):
            result[n, column] = (sums[n + width] - sums[n]) / width
    return count + 1


@kernel("UniTuple(float64, 2)(float64, float64, float64[:,::1], int64)")
def _nearest_on(x, y, chords, index):
    """Return the squared distance (m^2) of a point to a chord (see `lay_chords`), and the share of it before there."""
    dx, dy = chords[index, 2], chords[index, 3]
    px = x - chords[index, 0]
    py = y - chords[index, 1]
    along = (px * dx + py * dy) * chords[index, 4]
    along = 0.0 if along < 0.0 else (1.0 if along > 1.0 else along)
    px -= along * dx
    py -= along * dy
    return px * px + py * py, along


@kernel("void(float64[:,::1], int64, float64[:,::1])")
def lay_chords(line, step, chords):
    """Lay chords from each `step`-th corner of a polyline to the next, and to its end.

    Args:
        line: Shape (K, 2) in metres, K >= 2.
        step: Corners per chord; 1 gives the line's segments themselves.
        chords: Shape (C, 6), filled with start x, y (m), vector x, y (m), one over its squared length (saves divisions
            in loops), and the largest distance (m) of the line from the chord, rounded up.
    """
    end = line.shape[0] - 1
    for index in range(chords.shape[0]):
        first = index * step
        last = min(end, first + step)
        dx = line[last, 0] - line[first, 0]
        dy = line[last, 1] - line[first, 1]
        length = dx * dx + dy * dy
        chords[index, 0], chords[index, 1] = line[first, 0], line[first, 1]
        chords[index, 2], chords[index, 3] = dx, dy
        chords[index, 4] = 1.0 / length if length > 0.0 else 0.0
        off = 0.0  # a polyline is farthest from a chord at one of its corners
        for corner in range(first + 1, last):
            off = max(off, _nearest_on(line[corner, 0], line[corner, 1], chords, index)[0])
        chords[index, 5] = math.sqrt(off) + 1e-6


@kernel("void(float64[:,::1], float64[:,::1], float64[::1], float64[:,::1])")
def project(points, line, arcs, result):
    """Find the nearest point of a polyline for each point.

    Groups of _STRETCH segments are skipped where their chord is too far away for them to hold it.

    Args:
        points: Shape (M, 2) in metres; fastest where consecutive ones lie near each other.
        line: Shape (K, 2) in metres, K >= 2.
        arcs: Shape (K,): arc length (m) at each corner of the line.
        result: Shape (M, 2): filled with the distance (m) and the arc length (m) of the nearest point; of several, the
            first along the line.
    """
    count = line.shape[0] - 1
    pieces = np.empty((count, 6))
    lay_chords(line, 1, pieces)
    stretches = np.empty(((count + _STRETCH - 1) // _STRETCH, 6))
    lay_chords(line, _STRETCH, stretches)
    nearest_piece = 0
    for index in range(points.shape[0]):
        x, y = points[index, 0], points[index, 1]
        guess = math.sqrt(_nearest_on(x, y, pieces, nearest_piece)[0])
        nearest, nearest_along = 1e300, 0.0
        for stretch in range(stretches.shape[0]):
            reach = guess + stretches[stretch, 5]
            if _nearest_on(x, y, stretches, stretch)[0] > reach * reach:
                continue
            for piece in range(stretch * _STRETCH, min(count, (stretch + 1) * _STRETCH)):
                distance, along = _nearest_on(x, y, pieces, piece)
                if distance < nearest:
                    nearest, nearest_piece, nearest_along = distance, piece, along
            guess = min(guess, math.sqrt(nearest))
        result[index, 0] = math.sqrt(nearest)
        result[index, 1] = arcs[nearest_piece] + nearest_along * (arcs[nearest_piece + 1] - arcs[nearest_piece])
