"""Smoothness metrics of a trajectory: accelerations, jerks, changes of turning direction, standstill."""

from __future__ import annotations

import dataclasses

import numpy as np

TURNING = 0.05
"""Angular speed (rad/s) below which a robot counts as going straight, or standing."""


@dataclasses.dataclass(frozen=True)
class Smoothness:
    """Metrics of one drive; all zero where there are fewer than three samples.

    Attributes:
        turn_changes_per_metre: How often per metre the turning direction changed, left to right or back.
        mean_acceleration: Mean absolute acceleration along the path (m/s^2).
        mean_jerk: Mean absolute derivative of it (m/s^3).
        mean_angular_acceleration: Mean absolute angular acceleration (rad/s^2).
        standing_share: Share of samples below 0.005 m/s and below TURNING.
        mean_angular_jerk: Mean absolute derivative of the angular acceleration (rad/s^3).
    """

    turn_changes_per_metre: float = 0.0
    mean_acceleration: float = 0.0
    mean_jerk: float = 0.0
    mean_angular_acceleration: float = 0.0
    standing_share: float = 0.0
    mean_angular_jerk: float = 0.0


def path_length(positions: np.ndarray) -> float:
    """Return the length (m) of the polyline through `positions`, shape (N, 2) or wider."""
    steps = np.diff(np.asarray(positions, dtype=float)[:, :2], axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).sum())


def turn_changes(angular: np.ndarray) -> int:
    """Return how often the turning direction changed, ignoring angular speeds below TURNING.

    Args:
        angular: Angular velocities (rad/s), shape (N,).
    """
    sides = np.sign(angular[np.abs(angular) >= TURNING])
    return int(np.count_nonzero(np.diff(sides)))


def smoothness(times: np.ndarray, linear: np.ndarray, angular: np.ndarray, length: float) -> Smoothness:
    """Return the metrics of a drive.

    Args:
        times: Shape (N,), seconds, rising. Samples that follow the one before by less than half the longest period, as
            at the start and end of a drive, are left out: derivatives over so short a time would be huge.
        linear: Forward velocities (m/s), shape (N,); for an omnidirectional robot, speeds.
        angular: Angular velocities (rad/s), shape (N,).
        length: Length of the path driven (m).
    """
    whole = np.diff(times, prepend=-np.inf) >= 0.5 * np.diff(times).max(initial=0.0)
    times, linear, angular = times[whole], linear[whole], angular[whole]
    if len(times) < 3:
        return Smoothness()
    periods = np.diff(times)
    acceleration = np.diff(linear) / periods
    jerk = np.diff(acceleration) / periods[1:]
    angular_acceleration = np.diff(angular) / periods
    standing = (np.abs(linear) < 0.005) & (np.abs(angular) < TURNING)
    return Smoothness(
        turn_changes_per_metre=turn_changes(angular) / length if length > 0.0 else 0.0,
        mean_acceleration=float(np.abs(acceleration).mean()),
        mean_jerk=float(np.abs(jerk).mean()),
        mean_angular_acceleration=float(np.abs(angular_acceleration).mean()),
        standing_share=float(standing.mean()),
        mean_angular_jerk=float(np.abs(np.diff(angular_acceleration) / periods[1:]).mean()),
    )
