"""What can be set of the tracker."""

from __future__ import annotations

from dataclasses import dataclass

from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class TrackerParameters(ParameterSet):
    """Parameters of Tracker."""

    track_gap: float = parameter(0.1, "depth that parts two things in a scan", "m", above=0.0)
    track_largest: float = parameter(0.8, "extent above which a thing is no mover but a wall", "m", above=0.0)
    track_noise: float = parameter(0.025, "deviation of a thing's centre as measured", "m", above=0.0)
    track_acceleration: float = parameter(0.3, "deviation of its acceleration", "m/s^2", above=0.0)
    track_memory: float = parameter(
        1.0, "how long ago its place must have been seen empty for it to count as moving", "s", above=0.0)
    track_slowest: float = parameter(0.04, "speed below which it counts as standing", "m/s", minimum=0.0)
    track_odometry_error: float = parameter(
        0.3, "share of its motion between two scans by which odometry may be wrong, as scans laid on each other show; "
        "0 believes it", minimum=0.0, maximum=1.0)
    track_patience: float = parameter(1.0, "how long it is remembered unseen", "s", above=0.0)
