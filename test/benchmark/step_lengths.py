"""One drive, thinned: whether the filter knows as well where it is with a scan every 2 cm as with one every 2 m."""

from __future__ import annotations

from typing import Iterator, List, Tuple

import numpy as np

from benchmark.map_gaps import KNOWN_START, RIGHT_WITHIN, Condition, make_log
from benchmark.metric import Metric
from benchmark.synthetic_buildings import BUILDINGS
from mbf_relay.geometry import Pose2D
from mbf_relay.localization.logs import RecordedLog
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.replay import errors, replay
from mbf_relay.maps import OccupancyMap

SEED = 3410
STEPS = (0.02, 0.05, 0.2, 0.5, 1.0, 2.0)
LENGTH = 20.0
"""Way (m) of a drive."""
RANGE_MAX = 8.0


def metrics(buildings: int) -> Iterator[Metric]:
    """Yield, for each step, how far off the filter was where all steps have a scan, which is where the longest has."""
    names = list(BUILDINGS)[:buildings]
    common = {name: _thinned(name, STEPS[-1])[1] for name in names}
    for step in STEPS:
        medians: List[float] = []
        right: List[float] = []
        for name in names:
            log, truth, occupancy = _thinned(name, step)
            start = Pose2D(*map(float, truth[0]))
            result = replay(
                log, occupancy, LocalizerParameters(update_min_d=0.0, update_min_a=0.0), np.random.default_rng(SEED),
                start, KNOWN_START,
            )
            shared = _nearest(truth, common[name])
            off = errors(result.poses[shared], truth[shared])["translation"]
            medians.append(float(np.median(off)))
            right.append(100.0 * float((off < RIGHT_WITHIN).mean()))
        where = {"step [m]": step, "drives": len(medians), "length [m]": LENGTH}
        error = float(np.mean(medians))
        yield Metric("thinned: median error of a drive", error, "m", repeats=len(medians), parameters=where)
        yield Metric("thinned: scans within 0.5 m", float(np.mean(right)), "%", repeats=len(right), parameters=where)


def _thinned(building: str, step: float) -> Tuple[RecordedLog, np.ndarray, OccupancyMap]:
    """Return the drive through a building with a scan every `step` (m): log, true poses (N, 3), map to localize on."""
    log, occupancy = make_log(building, SEED, Condition(0.0, RANGE_MAX, step), finest=STEPS[0], length=LENGTH)
    assert log.reference is not None
    return log, log.reference, occupancy


def _nearest(poses: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """Return for each of the wanted poses the index of the nearest of others, both shape (N, 3), in metres and radians.
    """
    return np.array([int(np.argmin(np.abs(poses - one).sum(axis=1))) for one in wanted])
