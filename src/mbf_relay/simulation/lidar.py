"""The simulated planar lidar, with noise, limited range and resolution, dropouts and faults."""

from __future__ import annotations

import math
from typing import Optional

import numpy as np

from mbf_relay.scan import LaserScan
from mbf_relay.simulation.faults import Faults
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.robot import SCAN_FRAME
from mbf_relay.simulation.scene import Scene

DEAD = 0.0
"""Reading of a beam without measurement, as of an LDS-01; below range_min and therefore invalid."""


class Lidar:
    """A planar lidar with beams counter-clockwise: all round, the first along its x axis, or in a sector ahead.

    Without `scan_skew` all beams are measured at one time, which is the stamp. With it, each beam is measured when the
    rotating sensor points there, and the stamp is the middle of the acquisition: half a turn before the scan is
    complete, or more where the sensor's view is a sector. Rays never hit the robot itself.
    """

    def __init__(
        self, scene: Scene, parameters: SimulationParameters, in_base: Frame, rng: np.random.Generator
    ) -> None:
        """Mount the sensor.

        Args:
            scene: The bodies it sees.
            parameters: Its parameters are named scan_...
            in_base: Its pose in base_link.
            rng: Generator of its errors.
        """
        self._scene, self._parameters, self._in_base, self._rng = scene, parameters, in_base, rng
        self._steps = parameters.steps_between("scan_rate")
        self._increment = 2.0 * math.pi / parameters.scan_beams
        angles = parameters.beam_directions
        self._first = float(angles[0])
        self._directions = np.column_stack((np.cos(angles), np.sin(angles), np.zeros(len(angles))))
        self._skewed = np.full(len(angles), np.inf)
        self._last: Optional[np.ndarray] = None

    def sweep(self, base: Frame, step: int) -> None:
        """Measure the beams that the rotating sensor passes in one physics step, for `scan_skew`.

        Args:
            base: Pose of base_link in the world.
            step: Number of the step.
        """
        part = (step - 1) % self._steps
        turn, count = self._parameters.scan_beams, len(self._directions)
        beams = slice(min(part * turn // self._steps, count), min((part + 1) * turn // self._steps, count))
        if beams.start < beams.stop:
            self._skewed[beams] = self._distances(base, self._directions[beams])

    def restart(self, base: Frame) -> None:
        """Measure all beams again, with base_link at `base` in the world, after the robot was moved to another pose."""
        self._skewed = self._distances(base, self._directions)

    def scan(self, base: Frame, now: float, faults: Faults) -> Optional[LaserScan]:
        """Return the scan that is complete at `now` (s), with base_link at `base` in the world; None while silent."""
        if faults.lidar_silent:
            return None
        parameters = self._parameters
        if not faults.lidar_frozen or self._last is None:
            distances = self._skewed if parameters.scan_skew else self._distances(base, self._directions)
            self._last = self._with_short_ones(self._with_errors(distances), faults.short_readings)
        since_middle = 1.0 - 0.5 * len(self._directions) / parameters.scan_beams  # in turns
        stamp = now - since_middle * self._steps / parameters.physics_rate if parameters.scan_skew else now
        return LaserScan(
            self._without_dead_beams(self._last, faults), self._first, self._increment, parameters.scan_range_min,
            parameters.scan_range_max, stamp, SCAN_FRAME,
        )

    def _distances(self, base: Frame, directions: np.ndarray) -> np.ndarray:
        """Return true distances along unit vectors (B, 3) in its frame, shape (B,) in metres; +inf beyond its range."""
        sensor = base.compose(self._in_base)
        reach = self._parameters.scan_range_max
        shares = self._scene.cast(sensor.position, sensor.transform_points(reach * directions))
        return np.where(shares < 1.0, shares * reach, np.inf)

    def _with_errors(self, distances: np.ndarray) -> np.ndarray:
        """Return true distances with noise, rounding, range limits and dropouts applied, shape (B,) in metres."""
        parameters = self._parameters
        if parameters.scan_noise > 0.0:
            distances = distances + parameters.scan_noise * self._rng.standard_normal(len(distances))
        if parameters.scan_resolution > 0.0:
            distances = np.round(distances / parameters.scan_resolution) * parameters.scan_resolution
        distances = np.where(distances > parameters.scan_range_max, np.inf, distances)
        distances = np.where(distances < parameters.scan_range_min, DEAD, distances)
        if parameters.scan_dropout > 0.0:
            distances[self._rng.random(len(distances)) < parameters.scan_dropout] = np.inf
        return distances

    def _with_short_ones(self, ranges: np.ndarray, share: float) -> np.ndarray:
        """Return the readings, shape (B,), a random share of which is replaced by shorter ones, in place."""
        if share == 0.0:
            return ranges
        least = self._parameters.scan_range_min
        short = (self._rng.random(len(ranges)) < share) & (ranges >= least)
        ends = np.minimum(ranges[short], self._parameters.scan_range_max)
        ranges[short] = self._rng.uniform(least, ends)
        return ranges

    def _without_dead_beams(self, ranges: np.ndarray, faults: Faults) -> np.ndarray:
        """Return a copy of the readings, shape (B,), in which the dead beams read 0; those out of view are ignored."""
        ranges, turn = ranges.copy(), self._parameters.scan_beams
        first = round((faults.dead_beams_start - self._first) / self._increment)
        dead = (first + np.arange(round(faults.dead_beams * turn))) % turn
        ranges[dead[dead < len(ranges)]] = DEAD
        return ranges
