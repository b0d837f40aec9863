"""Odometry on its way from the wheels to whoever uses it, with the faults asked for."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Deque, Optional

from mbf_relay.simulation.drive import Odometry
from mbf_relay.simulation.faults import NO_FAULTS, Faults


class FaultyOdometry:
    """Lets readings come late, repeat, jump, or not at all."""

    def __init__(self) -> None:
        self._last: Optional[Odometry] = None
        self._under_way: Deque[Odometry] = deque()

    def newest(self, reading: Odometry, now: float, faults: Faults) -> Optional[Odometry]:
        """Take a reading and return the newest that has arrived since the last call, None where none has.

        Args:
            reading: What the wheels say.
            now: Time (s).
            faults: What is made to go wrong.
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
