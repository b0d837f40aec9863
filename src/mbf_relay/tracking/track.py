"""A track: the estimated state of a moving object."""

from __future__ import annotations

import math
from typing import NamedTuple, Sequence

import numpy as np

from mbf_relay.geometry import Pose2D


class Track(NamedTuple):
    """A moving object, approximated by a disc, in the frame of the scans.

    Attributes:
        number: Unique id among the tracks of one tracker, and of those it shares numbers with.
        stamp: Time (s) of the state.
        x, y: Its centre (m).
        vx, vy: Its velocity (m/s).
        radius: Its radius (m).
        position_variance: Variance of x, equal to that of y (m^2).
        covariance: Covariance of x and vx, equal to that of y and vy (m^2/s).
        velocity_variance: Variance of vx, equal to that of vy (m^2/s^2).
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
        """Its speed (m/s)."""
        return math.hypot(self.vx, self.vy)

    def seen_from(self, frame: Pose2D) -> Track:
        """Return the track in another frame; `frame` is the pose of its present frame in that one."""
        x, y, _ = frame.compose(Pose2D(self.x, self.y, 0.0))
        vx, vy, _ = Pose2D(0.0, 0.0, frame.theta).compose(Pose2D(self.vx, self.vy, 0.0))
        return self._replace(x=x, y=y, vx=vx, vy=vy)

    def at(self, time: float) -> Track:
        """Return the track predicted to a time (s) at constant velocity, without process noise."""
        ahead = time - self.stamp
        spread = self.position_variance + 2.0 * ahead * self.covariance + ahead * ahead * self.velocity_variance
        return self._replace(
            stamp=time, x=self.x + ahead * self.vx, y=self.y + ahead * self.vy, position_variance=max(0.0, spread),
            covariance=self.covariance + ahead * self.velocity_variance,
        )


def as_array(tracks: Sequence[Track], now: float) -> np.ndarray:
    """Return tracks predicted to a time (s) for kernels, shape (K, 8).

    Columns are x, y, vx, vy, radius, position_variance, covariance, velocity_variance.
    """
    rows = [track.at(now)[2:] for track in tracks]
    return np.array(rows, dtype=float).reshape(len(rows), 8)
