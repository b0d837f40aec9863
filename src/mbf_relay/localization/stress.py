"""Stress tests: a recorded drive with worse odometry, sparser scans or an incomplete map."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any, Dict, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import OCCUPIED_FROM
from mbf_relay.localization.logs import RecordedLog
from mbf_relay.maps import OccupancyMap
from mbf_relay.parameters import ParameterSet, parameter

BLOCK = 2.0
"""Side (m) of the blocks that are removed from a map."""
SLIP_SIZE = 0.3
"""Mean length (m) of a slip; its tail is exponential."""


@dataclass(frozen=True)
class Stress(ParameterSet):
    """Stress put on a recorded drive; the defaults leave it as it was recorded."""

    odometry: float = parameter(
        0.0, "standard deviation added to odometry after one metre; grows with the square root of the distance",
        unit="m", minimum=0.0, maximum=1.0)
    slips: float = parameter(
        0.0, "number of slips per metre, in each of which the wheels spin on for about 0.3 m", unit="1/m", minimum=0.0,
        maximum=10.0)
    unmapped: float = parameter(0.0, "share of the map's 2 m blocks that are removed", minimum=0.0, maximum=1.0)
    range_max: float = parameter(
        0.0, "readings of this and more count as no return; 0 for no limit", unit="m", minimum=0.0)
    beams: int = parameter(0, "number of evenly spaced beams kept of each scan; 0 for all", minimum=0)
    every: int = parameter(1, "keep one scan in so many", minimum=1)

    def __str__(self) -> str:
        changed = [f for f in fields(self) if getattr(self, f.name) != f.default]
        return " ".join(f"{f.name}={getattr(self, f.name):g}" for f in changed) or "as recorded"


def parse_stress(text: str) -> Stress:
    """Parse `name=value,name=value`; ValueError where it is none."""
    values: Dict[str, Any] = {}
    for part in text.split(","):
        name, equals, value = part.partition("=")
        try:
            values[name.strip()] = float(value) if name.strip() not in ("beams", "every") else int(value)
        except ValueError:
            equals = ""
        if not equals:
            raise ValueError(f"stress '{part}' is not NAME=NUMBER; e.g. --stress unmapped=0.3,range_max=3.5")
    known = [field.name for field in fields(Stress)]
    for name in values:
        if name not in known:
            raise ValueError(f"stress '{name}' is unknown; there are {', '.join(known)}")
    return Stress.from_mapping(values)


def stressed(
    log: RecordedLog, occupancy: OccupancyMap, stress: Stress, rng: np.random.Generator
) -> Tuple[RecordedLog, OccupancyMap]:
    """Return a log and its map under stress.

    Args:
        log: The drive.
        occupancy: Its map.
        stress: What is done to both.
        rng: Random generator.
    """
    odom = spoil(log.odom, stress, rng)[:: stress.every]
    ranges, increment, range_max = log.ranges[:: stress.every], log.angle_increment, log.range_max
    if stress.beams:
        step = max(1, -(-ranges.shape[1] // stress.beams))
        ranges, increment = np.ascontiguousarray(ranges[:, ::step]), increment * step
    if stress.range_max:
        range_max = min(range_max, stress.range_max)
        ranges = np.where(ranges >= range_max, np.inf, ranges)
    reference = None if log.reference is None else log.reference[:: stress.every]
    harder = replace(
        log, times=log.times[:: stress.every], odom=odom, ranges=ranges, angle_increment=increment,
        range_max=range_max, reference=reference,
    )
    if not stress.unmapped:  # nothing is drawn, so that a seed's trial as recorded is the replay of that seed
        return harder, occupancy
    return harder, without_blocks(occupancy, stress.unmapped, rng)


def spoil(odom: np.ndarray, stress: Stress, rng: np.random.Generator) -> np.ndarray:
    """Return odometry, shape (N, 3), with further errors; rows that are not finite stay as they are."""
    known = np.nonzero(np.isfinite(odom).all(axis=1))[0]
    if len(known) == 0 or not (stress.odometry or stress.slips):
        return odom
    spoiled, poses = odom.copy(), [Pose2D(*map(float, pose)) for pose in odom[known]]
    wrong = poses[0]
    for index, before, after in zip(known[1:], poses, poses[1:]):
        motion = after.relative_to(before)
        driven = math.hypot(motion.x, motion.y)
        root = stress.odometry * math.sqrt(driven + 0.25 * abs(motion.theta))
        noise = root * rng.standard_normal(2)
        spun = float(rng.exponential(SLIP_SIZE, rng.poisson(stress.slips * driven)).sum())
        longer = 1.0 + (noise[0] + spun) / driven if driven else 1.0
        wrong = wrong.compose(Pose2D(motion.x * longer, motion.y * longer, motion.theta + 0.5 * noise[1]))
        spoiled[index] = wrong
    return spoiled


def without_blocks(occupancy: OccupancyMap, share: float, rng: np.random.Generator) -> OccupancyMap:
    """Return a map in which each block is cleared of obstacles with the probability `share`."""
    height, width = occupancy.data.shape
    side = max(1, round(BLOCK / occupancy.resolution))
    gone = rng.random((1 + height // side, 1 + width // side)) < share
    rows, columns = np.arange(height) // side, np.arange(width) // side
    empty = gone[rows[:, None], columns[None, :]] & (occupancy.data >= OCCUPIED_FROM)
    return replace(occupancy, data=np.where(empty, np.int8(0), occupancy.data))

