"""Drives over maps that lack whole blocks of walls: the robust form of the filter against amcl's own, pair by pair.

One way, one odometry and one map for both, and for every distance between scans. The filter was tuned on drives with
seeds from TUNED_ON on; those with seeds from JUDGED_ON on judge it, and whoever changes the filter for a drive of
these takes others.
"""

from __future__ import annotations

import functools
import itertools
import math
from typing import Dict, Iterator, List, NamedTuple, Tuple

import numpy as np

from benchmark.metric import Metric
from benchmark.synthetic_buildings import BUILDINGS
from benchmark.synthetic_drives import as_map, wander
from mbf_relay.geometry import IDENTITY, Pose2D, angle_between
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.laser_kernels import cast_scan
from mbf_relay.localization.logs import RecordedLog
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.replay import errors, replay
from mbf_relay.localization.stress import without_blocks
from mbf_relay.maps import OccupancyMap
from mbf_relay.statistics import mean

TUNED_ON, JUDGED_ON = 3200, 3300
MISSING, REACHES, STEPS = (0.0, 0.3), (3.5, 8.0), (0.05, 0.2, 1.0)
"""Share of the blocks that the map lacks, ranges of the lidar (m), distances between scans (m)."""
LENGTH, LEG = 40.0, 0.6
"""Length (m) of a drive, and between the places where it may turn."""
FINEST, FINEST_TURN = 0.05, 0.2
"""Distance (m) and turn (rad) at which the way is cut for odometry."""
METRES_PER_RADIAN = 0.25
BEAMS, RANGE_NOISE = 180, 0.02
RIGHT_WITHIN = 0.5
KNOWN_START = np.diag([0.1, 0.1, 0.05]) ** 2
"""A robot that was put where it was told to be: what is asked is whether it is kept."""


class Condition(NamedTuple):
    """What a drive is like: share of blocks missing, range of the lidar (m), and metres from scan to scan."""

    missing: float
    range_max: float
    step: float


CONDITIONS = tuple(Condition(*values) for values in itertools.product(MISSING, REACHES, STEPS))


class Way(NamedTuple):
    """A drive, finely cut: true poses and odometry, each of shape (N, 3), and metres driven, shape (N,)."""

    truth: np.ndarray
    odom: np.ndarray
    driven: np.ndarray

    def every(self, step: float) -> np.ndarray:
        """Return the indices of its poses at which another `step` metres are driven, the first one's first."""
        return np.unique(np.searchsorted(self.driven, np.arange(0.0, self.driven[-1], step)))

    def log(self, chosen: np.ndarray, scans: np.ndarray, bearings: np.ndarray, range_max: float) -> RecordedLog:
        """Return what was recorded at the poses of some indices, shape (S,): scans, (S, B), of even bearings, (B,)."""
        return RecordedLog(
            np.arange(float(len(chosen))), self.odom[chosen], scans, 0.0, float(bearings[1]), range_max,
            self.truth[chosen],
        )


@functools.lru_cache(maxsize=4)
def make_way(building: str, seed: int, finest: float = FINEST, metres: float = LENGTH) -> Tuple[np.ndarray, Way]:
    """Return a building's walls, bool of shape (H, W), and a way through it.

    Args:
        building: A key of BUILDINGS.
        seed: Of walls, way and odometry.
        finest: Distance (m) at which the way is cut.
        metres: Its length.
    """
    rng = np.random.default_rng([seed, list(BUILDINGS).index(building)])
    walls = BUILDINGS[building](rng)
    corners = wander(DistanceField(as_map(walls), 5.0), int(metres / LEG), LEG, rng)
    truth = [corners[0]]
    for corner in corners[1:]:
        turn = angle_between(truth[-1].theta, corner.theta)
        turns = math.ceil(abs(turn) / FINEST_TURN)
        truth += [Pose2D(truth[-1].x, truth[-1].y, truth[-1].theta + turn * (i + 1) / turns) for i in range(turns)]
        before, steps = truth[-1], math.ceil(truth[-1].distance_to(corner) / finest)
        truth += [
            Pose2D(*map(float, np.array(before) + (np.array(corner) - before) * (i + 1) / steps * (1.0, 1.0, 0.0)))
            for i in range(steps)
        ]
    odometry = 0.02 * 10.0 ** rng.uniform(0.0, 0.7)
    return walls, _drive(truth, odometry, rng)


def _drive(truth: List[Pose2D], odometry: float, rng: np.random.Generator) -> Way:
    """Return the way with odometry that errs by `odometry`: so many metres after a metre, and half as much for ever."""
    scale, drift = 1.0 + 0.5 * odometry * rng.standard_normal(), 0.25 * odometry * rng.standard_normal()
    odom, driven = [IDENTITY], [0.0]
    for before, after in zip(truth[:-1], truth[1:]):
        motion = after.relative_to(before)
        length = math.hypot(motion.x, motion.y)
        way = length + METRES_PER_RADIAN * abs(motion.theta)
        noise = odometry * math.sqrt(way) * rng.standard_normal(2)
        turned = motion.theta * scale + length * drift + (0.5 if length else 1.0) * noise[1]
        # Two wheels know of no sideways motion.
        odom.append(odom[-1].compose(Pose2D(length * scale + noise[0] if length else 0.0, 0.0, turned)))
        driven.append(driven[-1] + way)
    return Way(np.array(truth), np.array(odom), np.array(driven))


def make_log(
    building: str, seed: int, condition: Condition, finest: float = FINEST, length: float = LENGTH
) -> Tuple[RecordedLog, OccupancyMap]:
    """Return a drive's log and the map to localize it on.

    Args:
        building: A key of BUILDINGS.
        seed: Of walls, way, odometry and map.
        condition: What the drive is like.
        finest: Distance (m) at which the way is cut, at most the condition's step.
        length: Of the way (m).
    """
    walls, way = make_way(building, seed, finest, length)
    rng = np.random.default_rng([seed, list(BUILDINGS).index(building), 1])
    occupancy = without_blocks(as_map(walls), condition.missing, rng)
    chosen = way.every(condition.step)
    field = DistanceField(as_map(walls), 2.0)
    bearings = np.arange(BEAMS) * (2.0 * math.pi / BEAMS)
    ranges, scans = np.empty(BEAMS), np.empty((len(chosen), BEAMS))
    for index, pose in enumerate(way.truth[chosen]):
        cast_scan(pose[None, :], field.blocked, field.frame, condition.range_max, bearings, ranges)
        noise = rng.normal(0.0, RANGE_NOISE, BEAMS)
        scans[index] = np.where(ranges < condition.range_max, ranges + noise, np.inf)
    return way.log(chosen, scans, bearings, condition.range_max), occupancy


def share_right(building: str, seed: int, condition: Condition, robust: bool) -> float:
    """Return the share of a drive's scans, 0 to 1, at which the filter knew where the robot was within RIGHT_WITHIN."""
    log, occupancy = make_log(building, seed, condition)
    # Every scan counts: denser updates are what the step between scans is about.
    parameters = LocalizerParameters(robust=robust, update_min_d=0.0, update_min_a=0.0)
    assert log.reference is not None
    start = Pose2D(*map(float, log.reference[0]))
    result = replay(log, occupancy, parameters, np.random.default_rng(seed), start, KNOWN_START)
    return float((errors(result.poses, log.reference)["translation"] < RIGHT_WITHIN).mean())


def metrics(quick: bool) -> Iterator[Metric]:
    """Yield how the two forms of the filter keep the robot, and by how much they differ, drive by drive."""
    seeds = range(JUDGED_ON, JUDGED_ON + (1 if quick else 6))
    for condition in CONDITIONS:
        groups: Dict[str, List[float]] = {}
        shares: Dict[bool, List[float]] = {True: [], False: []}
        for seed, building in itertools.product(seeds, BUILDINGS):
            for robust, kept in shares.items():
                kept.append(100.0 * share_right(building, seed, condition, robust))
            groups.setdefault(f"{building} {seed}", []).append(shares[True][-1] - shares[False][-1])
        difference = mean(groups)
        where = {**condition._asdict(), "drives": len(groups)}
        yield Metric("right, robust", float(np.mean(shares[True])), "%", repeats=len(groups), parameters=where)
        yield Metric("right, robust off", float(np.mean(shares[False])), "%", repeats=len(groups), parameters=where)
        interval = {**where, "interval": difference.interval()}
        yield Metric("right, robust less robust off", difference.value, "%", repeats=len(groups), parameters=interval)
