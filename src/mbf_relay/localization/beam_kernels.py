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
    """Pick every `step`-th reading of a scan but those that are no number.

    Args:
        readings: Shape (R,) in metres.
        step: Distance between the beams picked.
        first, increment: Direction (rad) of the first reading in the sensor's frame, and from one to the next.
        laser: Pose of the sensor in the base's frame, shape (3,).
        nearest, farthest: Limits (m) between which, themselves excluded, a reading says where something is.
        ranges: Result (m): what is not within the limits becomes `farthest`. As all results with room for R beams.
        bearings: Result (rad), in the base's frame.
        endpoints: Result (m), shape (R, 2), in the base's frame.
        silent: Result: whether nothing came back, nor from the beams to both sides.

    Returns:
        How many were picked.
    """
    count, before, last = 0, True, True  # whether nothing came back from the last two; beyond the ends nothing does
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
