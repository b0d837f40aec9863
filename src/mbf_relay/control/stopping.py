"""How a robot comes to a stand: by each component of its velocity, or by the wheels of a differential drive."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.geometry import Pose2D, Twist2D


def seconds_to_brake(
    velocity: Twist2D, acceleration: float, turn_acceleration: float, wheel_separation: float
) -> float:
    """Return how long (s) a robot brakes from a velocity until it stands.

    The two wheels of a differential drive have one acceleration for speed and turn together.

    Args:
        velocity: Body frame.
        acceleration: Of the speed, or of a wheel's rim (m/s^2).
        turn_acceleration: Of the turn (rad/s^2), where it brakes by itself.
        wheel_separation: Between the wheels (m); 0 where speed and turn brake each by itself.
    """
    speed, turn = velocity.speed(), abs(velocity.theta)
    if wheel_separation > 0.0:
        return (speed + 0.5 * wheel_separation * turn) / acceleration
    return max(speed / acceleration, turn / turn_acceleration)


def way_to_a_stand(
    start: Pose2D, velocity: Twist2D, wheel_separation: float, acceleration: float, step: float, turn_step: float
) -> np.ndarray:
    """Return the poses on which a differential drive comes to a stand whose wheels are told to stop, shape (S, 3).

    Each wheel slows down as hard as it can, by itself: while both do, the robot turns as fast as before, on a spiral.

    Args:
        start: Where braking begins.
        velocity: How fast it is there, body frame.
        wheel_separation: Between the wheels (m), above 0.
        acceleration: Of a wheel's rim (m/s^2).
        step, turn_step: Metres and radians from pose to pose, a little more where it bends most.
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
