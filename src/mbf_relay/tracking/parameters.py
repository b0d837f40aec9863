"""Parameters of the tracker."""

from __future__ import annotations

from dataclasses import dataclass

from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class TrackerParameters(ParameterSet):
    """Parameters of Tracker."""

    track_gap: float = parameter(
        0.1, "jump in range between neighbouring beams that separates two objects", "m", above=0.0)
    track_largest: float = parameter(
        0.8, "largest extent of an object that can move; anything larger is taken for a wall", "m", above=0.0)
    track_noise: float = parameter(0.025, "standard deviation of the measured centre of an object", "m", above=0.0)
    track_acceleration: float = parameter(0.3, "standard deviation of an object's acceleration", "m/s^2", above=0.0)
    track_memory: float = parameter(
        1.0, "an object counts as moving only if its place was seen empty this long ago", "s", above=0.0)
    track_slowest: float = parameter(0.04, "speed below which an object counts as standing", "m/s", minimum=0.0)
    track_odometry_error: float = parameter(
        0.3, "odometry is corrected by matching scans, by at most this share of the motion between two; 0 trusts "
        "odometry", minimum=0.0, maximum=1.0)
    track_patience: float = parameter(1.0, "how long an object out of sight is remembered", "s", above=0.0)
