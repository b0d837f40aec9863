"""A thing that moves, as the tracker knows it."""

from __future__ import annotations

import math
from typing import NamedTuple, Sequence

import numpy as np

from mbf_relay.geometry import Pose2D


class Track(NamedTuple):
    """One moving thing, taken for a disc, in the frame of the scans it was seen in.

    Attributes:
        number: Tells apart the tracks of one tracker, and of those it shares numbers with; never used twice.
        stamp: Time (s) of what follows.
        x, y: Its centre (m).
        vx, vy: Its velocity (m/s).
        radius: Metres.
        position_variance: Of x and of y alike (m^2).
        covariance: Of x with vx and of y with vy (m^2/s).
        velocity_variance: Of vx and of vy alike (m^2/s^2).
    """

    number: int
    stamp: float
    x: float
    y: float
    vx: float
    vy: float
    radius: float
    position_variance: float
    covariance: float
    velocity_variance: float

    @property
    def speed(self) -> float:
        """Metres per second."""
        return math.hypot(self.vx, self.vy)

    def seen_from(self, frame: Pose2D) -> Track:
        """Return it in another frame, in which `frame` is where the one it is given in lies."""
        x, y, _ = frame.compose(Pose2D(self.x, self.y, 0.0))
        vx, vy, _ = Pose2D(0.0, 0.0, frame.theta).compose(Pose2D(self.vx, self.vy, 0.0))
        return self._replace(x=x, y=y, vx=vx, vy=vy)

    def at(self, time: float) -> Track:
        """Return it where it will be at a time (s) if it goes on as it does."""
        ahead = time - self.stamp
        spread = self.position_variance + 2.0 * ahead * self.covariance + ahead * ahead * self.velocity_variance
        return self._replace(
            stamp=time, x=self.x + ahead * self.vx, y=self.y + ahead * self.vy, position_variance=max(0.0, spread),
            covariance=self.covariance + ahead * self.velocity_variance,
        )


def as_array(tracks: Sequence[Track], now: float) -> np.ndarray:
    """Return tracks at a time (s) for kernels: rows x, y, vx, vy, radius, and the variances of Track; shape (K, 8)."""
    rows = [track.at(now)[2:] for track in tracks]
    return np.array(rows, dtype=float).reshape(len(rows), 8)
