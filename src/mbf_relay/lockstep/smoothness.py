"""How calmly a robot drove: figures of a trajectory that a passenger would notice."""

from __future__ import annotations

import dataclasses

import numpy as np

TURNING = 0.05
"""Turning slower than this (rad/s) counts as going straight when changes of side are counted."""


@dataclasses.dataclass(frozen=True)
class Smoothness:
    """Figures of one drive; all zero for a robot that never moved.

    Attributes:
        turn_changes_per_metre: How often per metre the turning changed from left to right or back.
        mean_acceleration: Mean absolute acceleration along the path (m/s^2).
        mean_jerk: Mean absolute change of it (m/s^3).
        mean_angular_acceleration: Mean absolute angular acceleration (rad/s^2).
        standing_share: Share of the time in which it neither drove (0.005 m/s) nor turned (TURNING).
        mean_angular_jerk: Mean absolute change of the angular acceleration (rad/s^3).
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
    """Return how often the turning changed sides, ignoring what is slower than TURNING.

    Args:
        angular: Angular velocities (rad/s), shape (N,).
    """
    sides = np.sign(angular[np.abs(angular) >= TURNING])
    return int(np.count_nonzero(np.diff(sides)))


def smoothness(times: np.ndarray, linear: np.ndarray, angular: np.ndarray, length: float) -> Smoothness:
    """Return the figures of a drive.

    Args:
        times: Shape (N,), seconds, rising. A drive begins and ends between two samples: one that came sooner than half
            the longest period after the one before is left out, for the slightest change in so little time is a jerk.
        linear: Forward velocities (m/s), shape (N,); speeds, of a robot that goes sideways as well.
        angular: Angular velocities (rad/s), shape (N,).
        length: How far it drove (m).
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
