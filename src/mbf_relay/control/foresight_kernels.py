# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loop of foresight: when the footprint on its way meets something that is on its own."""

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


@kernel(
    "boolean(float64[:,::1], float64, float64[:,::1], float64[::1], float64, float64, float64, float64, float64, "
    "float64)"
)
def meets(outline, reach, tracks, rooms, time, x, y, theta, sureness, most_spread):
    """Return whether the footprint at a pose touches any track where it will be at a time.

    Args:
        outline: Shape (C, 2): corners (m) in the base frame.
        reach: Metres from the base to the farthest corner.
        tracks: Shape (K, 8): see tracking.track.as_array.
        rooms: Shape (K,): metres each has to the footprint as it stands; it counts as no wider than that.
        time: Seconds from when the tracks hold.
        x, y, theta: The base.
        sureness: Deviations of its place by which a track counts as wider.
        most_spread: Metres by which it does so at most.
    """
    cos, sin = math.cos(theta), math.sin(theta)
    for k in range(tracks.shape[0]):
        spread = math.sqrt(max(0.0, tracks[k, 5] + time * (2.0 * tracks[k, 6] + time * tracks[k, 7])))
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
    """Find when each trajectory, and the robot standing at its end after it, first meets a track.

    Args:
        outline, tracks, rooms, sureness, most_spread: As for `meets`.
        poses: Shape (N, S, 3).
        counts: Shape (N,): poses of each trajectory.
        steps: Shape (N,): seconds from one pose to the next, and to the first.
        horizon: Seconds after which nothing counts.
        wait: Seconds from one look to the next while it stands.
        times: Shape (N,): filled with seconds, infinite for no meeting.
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


@kernel("void(float64[:,::1], float64[:,::1], float64, float64, float64, float64[::1])")
def rooms_now(outline, tracks, x, y, theta, rooms):
    """Find the distance from the footprint to the centre of each track, shape (K,); see `meets`."""
    cos, sin = math.cos(theta), math.sin(theta)
    for k in range(tracks.shape[0]):
        dx, dy = tracks[k, 0] - x, tracks[k, 1] - y
        rooms[k] = distance_to_outline(outline, cos * dx + sin * dy, cos * dy - sin * dx)
