"""Simulated faults of odometry: delay, frozen readings, a jump, silence."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Deque, Optional

from mbf_relay.simulation.drive import Odometry
from mbf_relay.simulation.faults import NO_FAULTS, Faults


class FaultyOdometry:
    """Applies the faults to a stream of readings."""

    def __init__(self) -> None:
        self._last: Optional[Odometry] = None
        self._under_way: Deque[Odometry] = deque()

    def newest(self, reading: Odometry, now: float, faults: Faults) -> Optional[Odometry]:
        """Add a reading; return the newest one that has come through since the last call, None where none has.

        Args:
            reading: The reading without faults.
            now: Time (s).
            faults: The faults in force.
        """
        if faults == NO_FAULTS and not self._under_way:
            self._last = reading
            return reading
        if faults.odom_frozen and self._last is not None:
            reading = replace(self._last, stamp=now)
        self._last = reading
        pose = reading.pose
        self._under_way.append(replace(reading, pose=pose._replace(x=pose.x + faults.odom_jump)))
        arrived = None
        while self._under_way and self._under_way[0].stamp <= now - faults.odom_delay + 1e-9:
            arrived = self._under_way.popleft()
        return None if faults.odom_silent else arrived
