# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops of foresight: contacts of moving footprints with predicted tracks."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel("float64(float64[:,::1], float64, float64)")
def distance_to_outline(outline, x, y):
    """Return the distance (m) from a point to a polygon, 0 inside.

    Args:
        outline: Shape (C, 2): its corners in order.
        x, y: The point.
    """
    nearest = math.inf
    inside = False
    count = outline.shape[0]
    for corner in range(count):
        ax, ay = outline[corner, 0], outline[corner, 1]
        bx, by = outline[(corner + 1) % count, 0], outline[(corner + 1) % count, 1]
        dx, dy = bx - ax, by - ay
        squared = dx * dx + dy * dy
        along = ((x - ax) * dx + (y - ay) * dy) / squared if squared > 0.0 else 0.0
        along = min(1.0, max(0.0, along))
        nearest = min(nearest, math.hypot(ax + along * dx - x, ay + along * dy - y))
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            inside = not inside
    return 0.0 if inside else nearest


@kernel("float64(float64[:,::1], int64, float64)")
def spread_of(tracks, k, time):
    """Return the standard deviation (m) of a track's position after `time` (s); tracks: see tracking.track.as_array."""
    return math.sqrt(max(0.0, tracks[k, 5] + time * (2.0 * tracks[k, 6] + time * tracks[k, 7])))


@kernel("float64(float64, float64)")
def _badness(off, near):
    """Return the danger at a clearance of `off` (m): 1 for contact, falling to 0 at `near` (m)."""
    return 1.0 if off <= 0.0 else (1.0 - off / near) ** 2


@kernel(
    "boolean(float64[:,::1], float64, float64[:,::1], float64[::1], float64, float64, float64, float64, float64, "
    "float64)"
)
def meets(outline, reach, tracks, rooms, time, x, y, theta, sureness, most_spread):
    """Return whether the footprint at a pose touches any track at a time.

    Args:
        outline: Shape (C, 2): corners (m) in the base frame.
        reach: Distance (m) from the base to the farthest corner.
        tracks: Shape (K, 8): see tracking.track.as_array.
        rooms: Shape (K,): distance (m) of each track's centre from the present footprint, which limits its radius.
        time: Time (s) after that of the tracks.
        x, y, theta: Pose of the base (m, rad).
        sureness: Standard deviations of its position by which a track's radius is enlarged.
        most_spread: Limit (m) of that.
    """
    cos, sin = math.cos(theta), math.sin(theta)
    for k in range(tracks.shape[0]):
        spread = spread_of(tracks, k, time)
        radius = min(rooms[k], tracks[k, 4] + min(most_spread, sureness * spread))
        dx = tracks[k, 0] + time * tracks[k, 2] - x
        dy = tracks[k, 1] + time * tracks[k, 3] - y
        if dx * dx + dy * dy < (reach + radius) ** 2:
            if distance_to_outline(outline, cos * dx + sin * dy, cos * dy - sin * dx) < radius:
                return True
    return False


@kernel(
    "void(float64[:,::1], float64[:,::1], float64[::1], float64[:,:,::1], int64[::1], float64[::1], float64, float64, "
    "float64, float64, float64[::1])"
)
def first_meetings(outline, tracks, rooms, poses, counts, steps, horizon, wait, sureness, most_spread, times):
    """Find the first contact of each trajectory, and of the robot standing at its end afterwards, with a track.

    Args:
        outline, tracks, rooms, sureness, most_spread: As for `meets`.
        poses: Shape (N, S, 3).
        counts: Shape (N,): poses of each trajectory.
        steps: Shape (N,): seconds from one pose to the next, and to the first.
        horizon: Time (s) up to which contacts count.
        wait: Time (s) between checks while it stands.
        times: Shape (N,): filled with the time (s) of the contact, infinite for none.
    """
    reach = 0.0
    for corner in range(outline.shape[0]):
        reach = max(reach, math.hypot(outline[corner, 0], outline[corner, 1]))
    for n in range(poses.shape[0]):
        times[n] = np.inf
        time, last = 0.0, counts[n] - 1
        for index in range(counts[n]):
            time = (index + 1) * steps[n]
            if time > horizon:
                break
            if meets(outline, reach, tracks, rooms, time, poses[n, index, 0], poses[n, index, 1], poses[n, index, 2],
                     sureness, most_spread):
                times[n] = time
                break
        while times[n] == np.inf and time + wait <= horizon and last >= 0:
            time += wait
            if meets(outline, reach, tracks, rooms, time, poses[n, last, 0], poses[n, last, 1], poses[n, last, 2],
                     sureness, most_spread):
                times[n] = time


@kernel(
    "void(float64[:,::1], float64[:,::1], float64[::1], float64[:,:,::1], int64[::1], float64[::1], float64, "
    "boolean[::1])"
)
def runs_into(outline, tracks, rooms, poses, counts, steps, nearer, found):
    """Find trajectories that approach a track and touch the disc it can reach by then; see Foresight.runs_into.

    Args:
        outline, tracks, rooms: As for `meets`; tracks may move in any direction at their present speed.
        poses: Shape (N, S, 3).
        counts: Shape (N,): poses of each trajectory.
        steps: Shape (N,): seconds from one pose to the next, and to the first.
        nearer: Decrease (m) of the distance to a track's present position that counts as approaching.
        found: Shape (N,): filled.
    """
    reach = 0.0
    for corner in range(outline.shape[0]):
        reach = max(reach, math.hypot(outline[corner, 0], outline[corner, 1]))
    for n in range(poses.shape[0]):
        found[n] = False
        for k in range(tracks.shape[0]):
            speed = math.hypot(tracks[k, 2], tracks[k, 3])
            for index in range(counts[n]):
                covered = min(rooms[k], tracks[k, 4]) + (index + 1) * steps[n] * speed
                dx, dy = tracks[k, 0] - poses[n, index, 0], tracks[k, 1] - poses[n, index, 1]
                if dx * dx + dy * dy >= (reach + covered) ** 2:
                    continue
                cos, sin = math.cos(poses[n, index, 2]), math.sin(poses[n, index, 2])
                off = distance_to_outline(outline, cos * dx + sin * dy, cos * dy - sin * dx)
                if off < covered and off < rooms[k] - nearer:
                    found[n] = True
                    break


@kernel("void(float64[:,::1], float64[:,::1], float64, float64, float64, float64[::1])")
def rooms_now(outline, tracks, x, y, theta, rooms):
    """Fill `rooms`, (K,), with the distance (m) from the footprint at a pose to the centre of each track."""
    cos, sin = math.cos(theta), math.sin(theta)
    for k in range(tracks.shape[0]):
        dx, dy = tracks[k, 0] - x, tracks[k, 1] - y
        rooms[k] = distance_to_outline(outline, cos * dx + sin * dy, cos * dy - sin * dx)


@kernel(
    "void(float64[:,::1], float64[:,::1], float64[::1], float64[:,:,::1], float64, float64, float64, float64, "
    "float64, float64[::1])"
)
def exposures(outline, tracks, rooms, poses, step, margin, spreading, most_spread, memory, sums):
    """Find the time that each trajectory is in contact with tracks, or near them.

    Args:
        outline, tracks, rooms: As for `meets`.
        poses: Shape (N, S, 3).
        step: Time (s) between poses.
        margin, spreading, most_spread, memory: As for `lay`.
        sums: Shape (N,): filled with time (s), weighted by danger and age.
    """
    reach = 0.0
    for corner in range(outline.shape[0]):
        reach = max(reach, math.hypot(outline[corner, 0], outline[corner, 1]))
    for n in range(poses.shape[0]):
        sums[n] = 0.0
        for index in range(poses.shape[1]):
            time = (index + 1) * step
            x, y, theta = poses[n, index, 0], poses[n, index, 1], poses[n, index, 2]
            worst = 0.0
            for k in range(tracks.shape[0]):
                spread = spread_of(tracks, k, time)
                near = margin + min(most_spread, spreading * spread)
                radius = min(rooms[k], tracks[k, 4])
                dx = tracks[k, 0] + time * tracks[k, 2] - x
                dy = tracks[k, 1] + time * tracks[k, 3] - y
                if dx * dx + dy * dy < (reach + radius + near) ** 2:
                    cos, sin = math.cos(theta), math.sin(theta)
                    off = distance_to_outline(outline, cos * dx + sin * dy, cos * dy - sin * dx) - radius
                    if off < near:
                        worst = max(worst, _badness(off, near))
            sums[n] += step * worst * math.exp(-time / memory)


@kernel(
    "void(float64[:,::1], float64, float64, float64, float64, float64, float64, float64, float64, float64, "
    "float64[:,:,::1])"
)
def lay(tracks, x, y, cell, layer, radius, margin, spreading, most_spread, memory, dangers):
    """Fill a grid in space and time with danger: 1 for contact with a track, less near one, else 0.

    Args:
        tracks: As for `meets`.
        x, y: Centre of the grid (m).
        cell: Cell size (m).
        layer: Time (s) between layers; each stands for half of that before and after it.
        radius: Radius (m) of the robot, taken as a disc.
        margin: Clearance (m) below which there is danger.
        spreading: Standard deviations of a track's position added to that.
        most_spread: Limit (m) of the addition.
        memory: Time (s) after which predictions count by 1/e.
        dangers: Shape (T, n, n), n odd, rows along y: filled, the first layer with the danger after one `layer`.
    """
    layers, side = dangers.shape[0], dangers.shape[1]
    half = side // 2
    for t in range(layers):
        time = (t + 1) * layer
        weight = math.exp(-time / memory)
        dangers[t] = 0.0
        for k in range(tracks.shape[0]):
            spread = spread_of(tracks, k, time)
            near = margin + min(most_spread, spreading * spread)
            inner = radius + tracks[k, 4]
            outer = inner + near
            vx, vy = tracks[k, 2], tracks[k, 3]
            middle_x, middle_y = tracks[k, 0] + time * vx - x, tracks[k, 1] + time * vy - y
            ahead_x, ahead_y = 0.5 * layer * vx, 0.5 * layer * vy
            squared = ahead_x * ahead_x + ahead_y * ahead_y
            reach_x, reach_y = outer + abs(ahead_x), outer + abs(ahead_y)
            left = max(0, half + int(math.ceil((middle_x - reach_x) / cell)))
            right = min(side - 1, half + int(math.floor((middle_x + reach_x) / cell)))
            low = max(0, half + int(math.ceil((middle_y - reach_y) / cell)))
            high = min(side - 1, half + int(math.floor((middle_y + reach_y) / cell)))
            for row in range(low, high + 1):
                dy = (row - half) * cell - middle_y
                for column in range(left, right + 1):
                    dx = (column - half) * cell - middle_x
                    along = (dx * ahead_x + dy * ahead_y) / squared if squared > 0.0 else 0.0
                    along = min(1.0, max(-1.0, along))
                    off = math.hypot(dx - along * ahead_x, dy - along * ahead_y) - inner
                    if off < near:
                        dangers[t, row, column] = max(dangers[t, row, column], weight * _badness(off, near))
