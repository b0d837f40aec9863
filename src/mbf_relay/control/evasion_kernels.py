# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loop of evasion: simulation of manoeuvres within accelerations."""

from __future__ import annotations

import math

from mbf_relay.kernels import kernel

TURNED = 0.1  # rad left of a turn on the spot from which on the robot drives


@kernel(
    "void(float64[::1], float64[::1], float64[:,::1], float64, float64, float64, float64, float64, float64, float64, "
    "float64[:,:,::1], float64[:,::1])"
)
def roll_out(
    pose, velocity, manoeuvres, ahead, back, turn, radius, acceleration, turn_acceleration, period, poses, first
):
    """Simulate each manoeuvre: turn to a heading, on the spot or while driving, drive a distance, and stand.

    Args:
        pose: x, y, heading.
        velocity: Forward (m/s) and rotational (rad/s).
        manoeuvres: Shape (N, 3): turn (rad), distance (m, below 0 backwards), and a flag above 0 to turn first.
        ahead, back, turn: Top speeds forward and backwards (m/s, both above 0), and of turns (rad/s).
        radius: Minimum turning radius (m); 0 for a robot that turns on the spot.
        acceleration, turn_acceleration: Limits, m/s^2 and rad/s^2.
        period: Time (s) between poses.
        poses: Shape (N, S, 3): filled with the pose after each period.
        first: Shape (N, 2): filled with the velocities (m/s, rad/s) of the first period.
    """
    for n in range(manoeuvres.shape[0]):
        x, y, theta = pose[0], pose[1], pose[2]
        v, w = velocity[0], velocity[1]
        left, way = manoeuvres[n, 0], manoeuvres[n, 1]
        for step in range(poses.shape[1]):
            wanted = min(turn, math.sqrt(2.0 * turn_acceleration * abs(left)), abs(left) / period)
            if radius > 0.0:
                wanted = min(wanted, abs(v) / radius)
            wanted = math.copysign(wanted, left)
            w += min(turn_acceleration * period, max(-turn_acceleration * period, wanted - w))
            wanted = 0.0
            if manoeuvres[n, 2] <= 0.0 or abs(left) <= TURNED:
                top = ahead if way > 0.0 else back
                wanted = math.copysign(min(top, math.sqrt(2.0 * acceleration * abs(way)), abs(way) / period), way)
            v += min(acceleration * period, max(-acceleration * period, wanted - v))
            middle = theta + 0.5 * w * period
            x += v * math.cos(middle) * period
            y += v * math.sin(middle) * period
            theta += w * period
            left -= w * period
            way -= v * period
            poses[n, step, 0], poses[n, step, 1], poses[n, step, 2] = x, y, theta
            if step == 0:
                first[n, 0], first[n, 1] = v, w
