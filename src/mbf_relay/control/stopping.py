"""Time and way to brake to a stop: with independent axes, or with the two wheels of a differential drive."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.geometry import Pose2D, Twist2D


def seconds_to_brake(
    velocity: Twist2D, acceleration: float, turn_acceleration: float, wheel_separation: float
) -> float:
    """Return the time (s) to brake from a velocity to a stop.

    With a wheel separation the faster wheel decides; without, translation and rotation brake independently.

    Args:
        velocity: Body frame.
        acceleration: Translational deceleration, or that of a wheel's rim (m/s^2).
        turn_acceleration: Rotational deceleration (rad/s^2), used if wheel_separation is 0.
        wheel_separation: Distance between the wheels of a differential drive (m); 0 if unknown.
    """
    speed, turn = velocity.speed(), abs(velocity.theta)
    if wheel_separation > 0.0:
        return (speed + 0.5 * wheel_separation * turn) / acceleration
    return max(speed / acceleration, turn / turn_acceleration)


def way_to_a_stand(
    start: Pose2D, velocity: Twist2D, wheel_separation: float, acceleration: float, step: float, turn_step: float
) -> np.ndarray:
    """Return the poses, shape (S, 3), through which a differential drive stops when both wheels brake at once.

    Each wheel decelerates independently at the same rate: as long as both still roll, the rate of turning stays while
    the speed falls, so that the robot drives a spiral.

    Args:
        start: Pose at which braking begins.
        velocity: Velocity there, body frame.
        wheel_separation: Distance between the wheels (m), above 0.
        acceleration: Deceleration of a wheel's rim (m/s^2).
        step, turn_step: Spacing of the poses (m, rad); a little more where the curvature is highest.
    """
    speeds = velocity.x + 0.5 * wheel_separation * velocity.theta * np.array([-1.0, 1.0])
    stops = np.abs(speeds) / acceleration
    ways = 0.5 * speeds * stops
    need = max(float(np.abs(ways).max()) / step, abs(ways[1] - ways[0]) / wheel_separation / turn_step)
    shares = np.arange(1.0, math.ceil(need) + 1.0) / max(1, math.ceil(need))
    times = np.minimum(stops.max() * (1.0 - np.sqrt(1.0 - shares))[:, None], stops)  # even steps of the faster wheel
    rolled = np.diff(speeds * times - 0.5 * acceleration * np.sign(speeds) * times * times, axis=0, prepend=0.0)
    ahead, turns = rolled.mean(axis=1), (rolled[:, 1] - rolled[:, 0]) / wheel_separation
    headings = start.theta + np.cumsum(turns)
    x, y = (np.cumsum(ahead * part(headings - 0.5 * turns)) for part in (np.cos, np.sin))
    return np.column_stack((start.x + x, start.y + y, headings))
