"""Whether the reliability of a pose can be believed: robots placed right and wrong, on maps that lack blocks of walls.

Once on maps drawn from the walls themselves, once on such as surveys leave them.

Drives with seeds from JUDGED_ON on judge it; whoever changes the weights for a drive of these takes others.
"""

from __future__ import annotations

import itertools
import math
from typing import Callable, Dict, Iterator, List, NamedTuple, Tuple

import numpy as np
from scipy.stats import rankdata

from benchmark.map_gaps import KNOWN_START, Condition, make_log
from benchmark.metric import Metric
from benchmark.surveyed_maps import make_surveyed_log
from benchmark.synthetic_buildings import BUILDINGS
from mbf_relay.geometry import Pose2D, angle_between
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.logs import RecordedLog
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.reliability import RIGHT_TURN, RIGHT_WITHIN
from mbf_relay.maps import OccupancyMap
from mbf_relay.statistics import mean

JUDGED_ON = 3400
CONDITION = Condition(missing=0.3, range_max=3.5, step=0.2)
PLACED = ("right", "near", "anywhere")
"""Where a robot is told to be: where it is, one to four metres off, or anywhere on the map."""
NEAR, NEAR_TURN = (1.0, 4.0), 0.5
DOUBTED_BELOW = 0.5
MakeLog = Callable[[str, int, Condition], Tuple[RecordedLog, OccupancyMap]]
"""Makes a drive's log and its map from building, seed and condition."""
MAPS: Dict[str, MakeLog] = {"": make_log, "surveyed map, ": make_surveyed_log}
"""How the maps come about, each with how its metrics' names begin."""
BORDERS = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 1.0)
"""Of the classes of the calibration curve."""


class Told(NamedTuple):
    """What was told at each update of a drive, shape (N,), and whether the pose was right, bool of shape (N,)."""

    reliability: np.ndarray
    right: np.ndarray


def place(truth: Pose2D, placed: str, field: DistanceField, rng: np.random.Generator) -> Pose2D:
    """Return where a robot that stands at `truth` is told to be.

    Args:
        truth: Its pose.
        placed: One of PLACED.
        field: The map.
        rng: Where chance comes from.
    """
    if placed == "right":
        return truth
    poses = field.random_free_poses(20000, rng)
    if placed == "near":
        distances = np.hypot(poses[:, 0] - truth.x, poses[:, 1] - truth.y)
        poses = poses[(distances > NEAR[0]) & (distances < NEAR[1])]
        poses[:, 2] = truth.theta + rng.uniform(-NEAR_TURN, NEAR_TURN, len(poses))
    return Pose2D(*map(float, poses[0]))


def drive(building: str, seed: int, placed: str, make: MakeLog = make_log) -> Told:
    """Return what the filter tells on one drive.

    Args:
        building: A key of BUILDINGS.
        seed: Of all chance.
        placed: One of PLACED.
        make: Makes log and map.
    """
    log, occupancy = make(building, seed, CONDITION)
    assert log.reference is not None
    localizer = Localizer(
        LocalizerParameters(update_min_d=0.0, update_min_a=0.0), occupancy, np.random.default_rng(seed)
    )
    start = Pose2D(*map(float, log.reference[0]))
    localizer.set_initial_pose(place(start, placed, localizer.field, np.random.default_rng([seed, 7])), KNOWN_START)
    told: List[float] = []
    right: List[bool] = []
    for index, truth in enumerate(log.reference):
        estimate = localizer.process(log.odom_pose(index), log.scan(index), log.laser_pose)
        reliability = localizer.reliability()
        if estimate is None or reliability is None:
            continue
        off = math.hypot(estimate.pose.x - truth[0], estimate.pose.y - truth[1])
        told.append(reliability)
        right.append(off < RIGHT_WITHIN and abs(angle_between(estimate.pose.theta, truth[2])) < RIGHT_TURN)
    return Told(np.array(told), np.array(right))


def area_under_curve(values: np.ndarray, right: np.ndarray) -> float:
    """Return the probability that a right pose has a higher value than a wrong one; both shape (N,), ties halved."""
    ranks = rankdata(values)
    n_right, n_wrong = int(right.sum()), int((~right).sum())
    if not n_right or not n_wrong:
        return math.nan
    return float((ranks[right].sum() - 0.5 * n_right * (n_right + 1)) / (n_right * n_wrong))


def metrics(seeds: int, buildings: int = len(BUILDINGS)) -> Iterator[Metric]:
    """Yield area under the curve, flags and calibration over drives of so many seeds through so many buildings."""
    for prefix, make in MAPS.items():
        yield from _on_maps(prefix, make, seeds, buildings)


def _on_maps(prefix: str, make: MakeLog, seeds: int, buildings: int) -> Iterator[Metric]:
    drives: Dict[str, List[Told]] = {}
    for seed, building in itertools.product(range(JUDGED_ON, JUDGED_ON + seeds), list(BUILDINGS)[:buildings]):
        for placed in PLACED:
            drives.setdefault(f"{building} {seed}", []).append(drive(building, seed, placed, make))
    every = [one for group in drives.values() for one in group]
    told, right = np.concatenate([one.reliability for one in every]), np.concatenate([one.right for one in every])
    areas = {name: [_area(group)] for name, group in drives.items()}
    areas = {name: values for name, values in areas.items() if not math.isnan(values[0])}
    where = {**CONDITION._asdict(), "placed": ", ".join(PLACED), "drives": len(every)}
    yield Metric(f"{prefix}reliability: area under the curve", area_under_curve(told, right), "", parameters=where)
    of_worlds = mean(areas)
    yield Metric(
        f"{prefix}reliability: area under the curve in one building", of_worlds.value, "", repeats=len(areas),
        parameters={"interval": of_worlds.interval()},
    )
    doubted = told < DOUBTED_BELOW
    for name, chosen in (("wrong", ~right), ("right", right)):
        yield Metric(
            f"{prefix}reliability: {name} poses doubted", 100.0 * float(doubted[chosen].mean()), "%",
            repeats=int(chosen.sum()), parameters={"below": DOUBTED_BELOW},
        )
    for low, high in zip(BORDERS[:-1], BORDERS[1:]):
        chosen = (told >= low) & (told < high if high < 1.0 else told <= high)
        if chosen.any():
            yield Metric(
                f"{prefix}reliability: right where {low:g} to {high:g} was told", 100.0 * float(right[chosen].mean()),
                "%", repeats=int(chosen.sum()), parameters={"told, mean": round(100.0 * float(told[chosen].mean()), 1)},
            )


def _area(group: List[Told]) -> float:
    told, right = ([one[part] for one in group] for part in (0, 1))
    return area_under_curve(np.concatenate(told), np.concatenate(right))
