# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loop that picks beams from a scan."""

from __future__ import annotations

import math

from mbf_relay.kernels import kernel


@kernel(
    "int64(float64[::1], int64, float64, float64, float64[::1], float64, float64, float64[::1], float64[::1],"
    " float64[:,::1], boolean[::1])"
)
def pick(readings, step, first, increment, laser, nearest, farthest, ranges, bearings, endpoints, silent):
    """Pick every `step`-th reading of a scan and convert it to the base frame; NaN readings are left out.

    Args:
        readings: Shape (R,) in metres.
        step: Every how many readings one is picked.
        first, increment: Direction (rad) of the first reading in the sensor's frame, and from one to the next.
        laser: Pose of the sensor in the base's frame, shape (3,).
        nearest, farthest: Limits (m), both excluded, of valid readings.
        ranges: Result (m), shape (R,): readings, `farthest` where they are not within the limits. Of all results only
            the first rows, as many as are returned, are filled.
        bearings: Result (rad), shape (R,), in the base's frame.
        endpoints: Result (m), shape (R, 2), in the base's frame.
        silent: Result, shape (R,): whether this beam and both its picked neighbours read `farthest` or more.

    Returns:
        How many were picked.
    """
    count, before, last = 0, True, True  # of the last two beams, whether nothing came back; True beyond the ends
    for j in range(0, readings.shape[0], step):
        reading = readings[j]
        if math.isnan(reading):
            continue
        nothing = reading >= farthest
        if count > 0:
            silent[count - 1] = before and last and nothing
        before, last = last, nothing
        distance = reading if nearest < reading < farthest else farthest
        bearing = (first + increment * j) + laser[2]
        ranges[count], bearings[count] = distance, bearing
        endpoints[count, 0] = laser[0] + distance * math.cos(bearing)
        endpoints[count, 1] = laser[1] + distance * math.sin(bearing)
        count += 1
    if count > 0:
        silent[count - 1] = before and last
    return count
