# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled collision checks of a footprint on a costmap: contacts at poses, the first contact along trajectories.

In several kernels, cells from LETHAL up to the cost `in_way` are obstacles: 254 for lethal ones alone, 255 for unknown
ones and all outside the grid as well. "In cells" means coordinates in units of cells from the grid's origin.

`_LETHAL` is a copy of cost_grid's: numba's cache only notices changes of the kernel's own file. A test compares them.
"""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

_LETHAL = 254
ARC = 8  # consecutive outline points with one bounding circle: some three cells' length
_RUN = 16  # poses of a path with one bounding box: some eight cells' length
_AS_QUICK = 32  # cells scanned for an obstacle in about the time of one distance from a cell to a side
MOST_LOOKED_AT = 40_000_000
"""Most distances from a cell to a side of the footprint computed for one batch of trajectories: half a second."""
_HAIR = 1e-6  # cells: tolerance for rounding in comparisons of depths
_NUDGE = 1e-3  # cells: step of the difference quotient of a depth
OUTS = 8
"""Sectors of a full circle in which what is touched at the start is told apart."""
_ROUNDING = 1e-6  # share of the outline's radius by which its float32 points may lie farther out


@kernel("boolean(float32[:,::1], float64, float64, float64)")
def is_far(distances, across, up, reach):
    """Return whether no obstacle and no edge of the grid lies within `reach` of a point; all lengths in cells.

    Args:
        distances: Shape (H, W): distance from each cell's centre to that of the nearest obstacle.
        across, up: Coordinates of the point.
        reach: Radius.
    """
    height, width = distances.shape
    if not (across - reach >= 0.0 and up - reach >= 0.0 and across + reach < width and up + reach < height):
        return False
    return distances[np.uint64(up), np.uint64(across)] > reach + 1.4143


@kernel("int64(uint8[:,::1], float32[:,::1], float64, float64, float64, boolean, float64, int64, int64, int64)")
def _contacts_between(costs, outline, across, up, factor, inside, overlap, in_way, first, last):
    """Return how many of an outline's points with indices from `first` to `last` - 1 are in contact; see `contacts`.

    Args:
        costs, overlap, in_way: As for `contacts`.
        outline: Shape (P, 2): points (m) around the outline, already turned to the heading.
        across, up: The base, in cells.
        factor: Cells per metre of the outline, its scale included.
        inside: Whether all these points are known to lie in the grid.
        first, last: Range of indices.
    """
    height, width = costs.shape
    found = 0
    for point in range(first, last):
        in_x = across + factor * outline[point, 0]
        in_y = up + factor * outline[point, 1]
        if inside and costs[np.uint64(in_y), np.uint64(in_x)] < _LETHAL:
            continue  # most points of most poses
        column, row = int(math.floor(in_x)), int(math.floor(in_y))
        if column < 0 or row < 0 or column >= width or row >= height:
            found += in_way > _LETHAL
        elif _LETHAL <= costs[row, column] <= in_way:
            in_x -= column
            in_y -= row
            grazes = (
                (in_x < overlap and column > 0 and not _LETHAL <= costs[row, column - 1] <= in_way)
                or (in_x > 1.0 - overlap and column + 1 < width and not _LETHAL <= costs[row, column + 1] <= in_way)
                or (in_y < overlap and row > 0 and not _LETHAL <= costs[row - 1, column] <= in_way)
                or (in_y > 1.0 - overlap and row + 1 < height and not _LETHAL <= costs[row + 1, column] <= in_way)
            )
            if not grazes:
                found += 1
    return found


@kernel("int64(float64, int64)")
def _heading(theta, headings):
    """Return the index of the heading nearest to an angle (rad), of `headings` evenly spread over a full circle."""
    return int(math.floor(theta * headings / (2.0 * math.pi) + 0.5)) % headings


@kernel(
    "int64(uint8[:,::1], float64, float64, float64, float32[:,:,::1], float64, float64, int64, float64, float64, "
    "float64, float64)"
)
def contacts(
    costs, origin_x, origin_y, resolution, outlines, circumscribed, overlap, in_way, x, y, theta, scale
):
    """Return how many points of a footprint's outline are in contact: on an obstacle's cell or outside the grid.

    Args:
        costs: Shape (H, W), uint8.
        origin_x, origin_y, resolution: The grid's lower left corner and the side of its cells (m).
        outlines: Shape (A, P, 2): points (m) around the outline, turned to each of A headings of a full circle.
        circumscribed: Radius (m) of the outline at scale 1.
        overlap: Share of a cell by which the outline may reach into an obstacle's cell from a free one beside it.
        in_way: Highest cost of an obstacle, 254 or 255; see the module.
        x, y, theta: Pose of the base (m, rad) in the grid's frame.
        scale: Factor on the outline.
    """
    height, width = costs.shape
    across = (x - origin_x) / resolution
    up = (y - origin_y) / resolution
    reach = (1.0 + _ROUNDING) * circumscribed * scale / resolution
    inside = across - reach >= 0.0 and up - reach >= 0.0 and across + reach < width and up + reach < height
    outline = outlines[_heading(theta, outlines.shape[0])]
    return _contacts_between(
        costs, outline, across, up, scale / resolution, inside, overlap, in_way, 0, outline.shape[0])


@kernel("boolean(uint8[:,::1], int64, int64, int64, int64, int64)")
def _is_clear(costs, in_way, x0, y0, x1, y1):
    """Return whether no obstacle lies in columns x0 to x1 and rows y0 to y1, the ends included.

    Each row is scanned without branches, so that the compiler makes vector code of it.
    """
    height, width = costs.shape
    if in_way > _LETHAL and (x0 < 0 or y0 < 0 or x1 >= width or y1 >= height):
        return False
    lowest, span = np.uint8(_LETHAL), np.uint8(in_way - _LETHAL)
    for y in range(max(y0, 0), min(y1 + 1, height)):
        row = costs[y, max(x0, 0):max(min(x1 + 1, width), 0)]
        found = np.uint8(0)
        for x in range(row.shape[0]):
            found |= np.uint8(np.uint8(row[x] - lowest) <= span)
        if found != 0:
            return False
    return True


@kernel("UniTuple(float64, 2)(float64, float64, float64, float64, float64)")
def _between(low, high, slope, begin, end):
    """Return the part of an interval on which low <= slope * t <= high; its end is below its begin for none."""
    if abs(slope) < 1e-9:
        return (begin, end) if low <= 0.0 <= high else (end, begin - 2.0)
    one, other = low / slope, high / slope
    return max(begin, min(one, other)), min(end, max(one, other))


@kernel("float64(float64[:,::1], float64, float64, float64, float64)")
def _depth(corners, factor, margin, ahead, left):
    """Return the depth (cells) of a cell whose centre lies `ahead`, `left` (cells) in the base frame; see `depths`.

    Args:
        corners: As for `depths`.
        factor: Cells per metre of the corners, the scale included.
        margin: Half a cell less the overlap (cells).
        ahead, left: Place of the cell's centre.
    """
    nearest, is_within = math.inf, False
    for k in range(corners.shape[0]):
        x0, y0 = factor * corners[k - 1, 0], factor * corners[k - 1, 1]
        x1, y1 = factor * corners[k, 0], factor * corners[k, 1]
        dx, dy = x1 - x0, y1 - y0
        share = 0.0
        if dx != 0.0 or dy != 0.0:
            share = min(1.0, max(0.0, ((ahead - x0) * dx + (left - y0) * dy) / (dx * dx + dy * dy)))
        off_x, off_y = ahead - x0 - share * dx, left - y0 - share * dy
        nearest = min(nearest, off_x * off_x + off_y * off_y)
        if (y0 > left) != (y1 > left) and ahead < x0 + (left - y0) / dy * dx:
            is_within = not is_within
    return margin + math.sqrt(nearest) if is_within else margin - math.sqrt(nearest)


@kernel(
    "int64(uint8[:,::1], float64, float64, float64, float64[:,::1], float64, float64, int64, float64, float64, "
    "float64, float64, float64[::1], float64[:,::1], float64[::1])"
)
def depths(
    costs, origin_x, origin_y, resolution, corners, circumscribed, overlap, in_way, x, y, theta, scale, start, outs,
    found,
):
    """Compute how deep a footprint penetrates obstacles, and what lies outside the grid; return the work done.

    A cell's depth is the distance from its centre to the outline, positive inside, plus half a cell less `overlap`;
    cells of depths above 0 are penetrated. Unlike the number of outline points in a cell, the depth is constant while
    a side slides along it, and grows as the robot goes on into it.

    With a `start`, a cell may be penetrated as deep as it was there, or if one of `outs`, by which the footprint would
    have left what it penetrated there, lets it leave the cell as well: so a side slides along a wall that it touches,
    and is no leave to run into another.

    Args:
        corners: Shape (K, 2): the footprint's corners (m) in the base frame.
        start: Where the robot is: column, row (cells from the origin), cosine and sine of its heading; or empty.
        outs: Shape (OUTS, 2): for each of OUTS directions from the footprint to a cell, the vector (cells) by which the
            deepest cell would leave. Filled where `start` is empty, with zeros before.
        found: Shape (2,), filled with the largest depth (cells) and the sum over all penetrated cells, 0 without any;
            infinite where a cell is penetrated deeper, or that would take more than MOST_LOOKED_AT.
        costs, origin_x, origin_y, resolution, circumscribed, overlap, in_way, x, y, theta, scale: As for `contacts`.

    Returns:
        Number of distances from a cell to a side that were computed; cells scanned count as 1 / _AS_QUICK of one.
    """
    height, width = costs.shape
    margin, factor = 0.5 - overlap, scale / resolution
    across = (x - origin_x) / resolution
    up = (y - origin_y) / resolution
    reach = circumscribed * factor + margin
    cos, sin = math.cos(theta), math.sin(theta)
    back, front = factor * corners[:, 0].min() - margin, factor * corners[:, 0].max() + margin
    right, far_left = factor * corners[:, 1].min() - margin, factor * corners[:, 1].max() + margin
    found[0] = found[1] = 0.0
    looked_at = 0
    for row in range(int(math.floor(up - reach - 0.5)), int(math.floor(up + reach + 0.5)) + 1):
        above = row + 0.5 - up
        begin, end = _between(back - sin * above, front - sin * above, cos, -reach, reach)
        begin, end = _between(right - cos * above, far_left - cos * above, -sin, begin, end)
        first, last = int(math.floor(across + begin - 1.0)), int(math.floor(across + end)) + 1
        looked_at += 1 + max(0, last - first) // _AS_QUICK
        if first > last or _is_clear(costs, in_way, first, row, last, row):
            continue
        for column in range(first, last + 1):
            if column < 0 or row < 0 or column >= width or row >= height:
                if in_way <= _LETHAL:
                    continue
            elif not _LETHAL <= costs[row, column] <= in_way:
                continue
            ahead = cos * (column + 0.5 - across) + sin * above
            left = cos * above - sin * (column + 0.5 - across)
            if not (back < ahead < front and right < left < far_left):
                continue  # outside the footprint's box, as most cells of a wall beside it
            looked_at += corners.shape[0]
            if looked_at > MOST_LOOKED_AT:
                found[0] = found[1] = math.inf
                return looked_at
            depth = _depth(corners, factor, margin, ahead, left)
            if depth <= 0.0:
                continue
            found[0] = max(found[0], depth)
            found[1] += depth
            if start.shape[0] == 0:
                out_ahead = _depth(corners, factor, margin, ahead - _NUDGE, left) - _depth(
                    corners, factor, margin, ahead + _NUDGE, left)
                out_left = _depth(corners, factor, margin, ahead, left - _NUDGE) - _depth(
                    corners, factor, margin, ahead, left + _NUDGE)
                length, looked_at = math.hypot(out_ahead, out_left), looked_at + 4 * corners.shape[0]
                x, y = cos * out_ahead - sin * out_left, sin * out_ahead + cos * out_left
                out = int(math.floor(math.atan2(y, x) * OUTS / (2.0 * math.pi) + 0.5)) % OUTS
                is_one_way = length > 1.9 * _NUDGE  # and not two, as of a cell as near to one side as to another
                if is_one_way and depth > math.hypot(outs[out, 0], outs[out, 1]):
                    outs[out, 0], outs[out, 1] = depth * x / length, depth * y / length
                continue
            is_deeper = True
            for out in range(OUTS):
                x, y = ahead + cos * outs[out, 0] + sin * outs[out, 1], left + cos * outs[out, 1] - sin * outs[out, 0]
                if is_deeper and (x != ahead or y != left):
                    is_deeper = back + _HAIR < x < front - _HAIR and right + _HAIR < y < far_left - _HAIR
                    if is_deeper:
                        looked_at += corners.shape[0]
                        is_deeper = _depth(corners, factor, margin, x, y) > _HAIR
            if is_deeper:
                x, y = column + 0.5 - start[0], row + 0.5 - start[1]
                looked_at += corners.shape[0]
                is_deeper = depth > _HAIR + _depth(
                    corners, 1.0 / resolution, margin, start[2] * x + start[3] * y, start[2] * y - start[3] * x)
            if is_deeper:
                found[0] = found[1] = math.inf
                return looked_at
    return looked_at


@kernel(
    "void(uint8[:,::1], float64, float64, float64, float32[:,:,::1], float32[:,::1], float64, float64, int64, "
    "float64[:,::1], uint8[::1])"
)
def touching(costs, origin_x, origin_y, resolution, outlines, boxes, circumscribed, overlap, in_way, poses, result):
    """Find the poses at which the footprint is in contact.

    The outline's points are looked at only where an obstacle lies in its bounding box; runs of consecutive poses are
    first checked by their common box.

    Args:
        boxes: Shape (A, 4): least x, least y, largest x and largest y (m) of the outline at each heading.
        costs, origin_x, origin_y, resolution, outlines, circumscribed, overlap, in_way: As for `contacts`.
        poses: Shape (N, 3), in the grid's frame.
        result: Shape (N,), filled with 1 for contact and 0 for none.
    """
    headings = outlines.shape[0]
    windows = np.empty((_RUN, 4), np.int64)
    widest = 4.0 * circumscribed / resolution + _RUN  # cells; poses farther apart are no path: each is checked alone
    for first in range(0, poses.shape[0], _RUN):
        count = min(_RUN, poses.shape[0] - first)
        for n in range(count):
            across, up = (poses[first + n, 0] - origin_x) / resolution, (poses[first + n, 1] - origin_y) / resolution
            box = boxes[_heading(poses[first + n, 2], headings)]
            for k in range(4):
                windows[n, k] = math.floor((up if k & 1 else across) + box[k] / resolution)
        x0, y0 = windows[:count, 0].min(), windows[:count, 1].min()
        x1, y1 = windows[:count, 2].max(), windows[:count, 3].max()
        clear = max(x1 - x0, y1 - y0) <= widest and _is_clear(costs, in_way, x0, y0, x1, y1)
        for n in range(first, first + count):
            x0, y0, x1, y1 = windows[n - first]
            result[n] = not (clear or _is_clear(costs, in_way, x0, y0, x1, y1)) and contacts(
                costs, origin_x, origin_y, resolution, outlines, circumscribed, overlap, in_way, poses[n, 0],
                poses[n, 1], poses[n, 2], 1.0) > 0


@kernel(
    "int64(uint8[:,::1], float32[:,::1], float64, float64, float64, float64, float32[:,:,::1], float32[:,:,::1], "
    "float64[:,::1], float64, float64, int64, float64[:,:,::1], int64[::1], float64[::1], float64[::1], "
    "float64[:,::1], int64[::1], float64[::1], float64[::1])"
)
def first_contacts(
    costs, distances, known, origin_x, origin_y, resolution, outlines, arcs, corners, circumscribed, overlap, in_way,
    poses, counts, scales, start, outs, free, highest, summed,
):
    """Find how far along each trajectory the footprint is free of contact, and the costs under the base on the way.

    Points of the outline are looked at only in arcs whose circle is near an obstacle. The distance from the arcs to the
    nearest obstacle then tells how far the footprint may move before the next look (conservative advancement, Mirtich
    1996). A robot that starts in contact may move as long as it penetrates no cell deeper, see `depths`. Computing
    depths is limited to MOST_LOOKED_AT: each trajectory has an equal share and what those before it left. A trajectory
    ends as in contact where its share is used up, as with a large footprint on unknown cells.

    Args:
        distances: As for `is_far`.
        known: Cells up to which `distances` are exact.
        costs, origin_x, origin_y, resolution, outlines, circumscribed, overlap, in_way: As for `contacts`.
        arcs: Shape (A, K, 3): at each heading, for every ARC points of the outline, a circle (x, y, radius; m) that
            holds them.
        corners: As for `depths`.
        poses: Shape (N, S, 3), in the grid's frame.
        counts: Shape (N,): number of poses of each trajectory.
        scales: Shape (N,): factor on the footprint.
        start, outs: As for `depths`; `start` is empty where the robot has no contact.
        free: Shape (N,), filled with the number of poses before the first contact.
        highest, summed: Shape (N,), filled with the highest and the summed cost under the base at these poses.
    """
    height, width = costs.shape
    points = outlines.shape[1]
    entered = np.empty(2)
    looked_at, number = 0, poses.shape[0]
    for n in range(number):
        may_look_at = MOST_LOOKED_AT * (n + 1) // number
        factor, reach = scales[n] / resolution, (1.0 + _ROUNDING) * circumscribed * scales[n] / resolution
        touches = start.shape[0] > 0
        free[n] = counts[n]
        highest[n] = 0.0
        summed[n] = 0.0
        moved, room = 0.0, -1.0  # cells that the outermost point has moved since the last look, and may before the next
        for i in range(counts[n]):
            across, up = (poses[n, i, 0] - origin_x) / resolution, (poses[n, i, 1] - origin_y) / resolution
            found = 0
            if room > 0.0:
                moved += reach * abs(poses[n, i, 2] - poses[n, i - 1, 2]) + math.hypot(
                    poses[n, i, 0] - poses[n, i - 1, 0], poses[n, i, 1] - poses[n, i - 1, 1]) / resolution
            if not moved < room and not is_far(distances, across, up, reach):
                heading = _heading(poses[n, i, 2], outlines.shape[0])
                moved, room = 0.0, known
                for k in range(arcs.shape[1]):
                    x, y = across + factor * arcs[heading, k, 0], up + factor * arcs[heading, k, 1]
                    radius = factor * arcs[heading, k, 2]
                    away = min(x, y, width - x, height - y) - radius
                    inside = away > 0.0
                    if inside:
                        away = min(away, distances[np.uint64(y), np.uint64(x)] - radius - 1.4143)
                    room = min(room, away)
                    if away > 0.0:
                        continue
                    found = _contacts_between(
                        costs, outlines[heading], across, up, factor, inside, overlap, in_way, ARC * k,
                        min(ARC * k + ARC, points))
                    if found > 0:
                        break
                room -= reach * 2.0 * math.pi / outlines.shape[0]  # headings are rounded by half a step, here and there
            if not touches:
                if found > 0:
                    free[n] = i
                    break
            elif looked_at >= may_look_at:
                free[n] = i
                break
            else:
                looked_at += depths(
                    costs, origin_x, origin_y, resolution, corners, circumscribed, overlap, in_way, poses[n, i, 0],
                    poses[n, i, 1], poses[n, i, 2], scales[n], start, outs, entered)
                if found == 0 and entered[0] <= 0.5 - overlap:  # contact has ended: from here on none is allowed
                    touches = False
                elif not math.isfinite(entered[0]):
                    free[n] = i
                    break
            column, row = int(math.floor(across)), int(math.floor(up))
            if column < 0 or row < 0 or column >= width or row >= height:
                free[n] = i
                break
            cost = float(costs[row, column])
            highest[n] = max(highest[n], cost)
            summed[n] += cost
    return looked_at
