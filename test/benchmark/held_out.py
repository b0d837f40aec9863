"""A judgement of the localizer by drives that took no part in its making.

Every drive has a building, a lidar, odometry and disorder of its own. The filter's constants were chosen on rough
drives of the familiar buildings with seeds below 10, and causes of failure were looked for on seeds 100 to 199 of all
kinds and then on 1000 to 1009, which are spent by that. What is judged has seeds from HELD_OUT_FROM on; whoever changes
the filter for a drive of those takes others.
"""

from __future__ import annotations

import math
from typing import Iterator, List, NamedTuple

import numpy as np

from benchmark.metric import Metric, metric_of
from benchmark.synthetic_buildings import BUILDINGS
from benchmark.synthetic_drives import Rough, make_drive
from mbf_relay.geometry import Pose2D
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.replay import LOST_FROM, errors, replay

HELD_OUT_FROM = 2000
SCANS = 200
START_COVARIANCE = np.diag([0.25, 0.25, (math.pi / 12.0) ** 2])
LAST = 10
"""Scans at the end of a drive by which it is told whether the robot was lost."""


class Verdict(NamedTuple):
    """How a drive was tracked.

    Attributes:
        median: Median error (m).
        near, kept: Share of the scans with an error below 0.1 m and below 0.5 m.
        lost: Whether the robot was lost at the end.
    """

    median: float
    near: float
    kept: float
    lost: bool


def conditions(rng: np.random.Generator) -> Rough:
    """Draw how a drive goes: from good odometry in an empty building to none to speak of in a crowd."""
    return Rough(
        step=rng.uniform(0.2, 1.0),
        odometry=0.02 * 10.0 ** rng.uniform(0.0, 1.0),
        slips=float(rng.choice([0.0, 0.03])),
        unmapped=float(rng.choice([0.0, 0.15])),
        people=int(rng.integers(0, 5)),
        furniture=int(rng.choice([0, 20])),
        beams=int(rng.choice([30, 60, 90, 181, 360])),
        range_max=float(rng.choice([3.5, 6.0, 12.0, 20.0])),
        view=float(rng.choice([math.pi, 2.0 * math.pi])),
    )


def judge(building: str, seed: int, parameters: LocalizerParameters) -> Verdict:
    """Replay one drive from a roughly known start."""
    rng = np.random.default_rng([seed, list(BUILDINGS).index(building)])
    made = make_drive(building, SCANS, conditions(rng), rng)
    start = Pose2D(*map(float, made.log.reference[0]))
    result = replay(made.log, made.occupancy, parameters, np.random.default_rng(seed), start, START_COVARIANCE)
    off = errors(result.poses, made.log.reference)["translation"]
    lost = bool(np.median(off[-LAST:]) > LOST_FROM)
    return Verdict(float(np.median(off)), float((off < 0.1).mean()), float((off < 0.5).mean()), lost)


def held_out_drives(count: int) -> Iterator[Metric]:
    """Judge so many held-out drives through each kind of building, as we track them and as amcl does."""
    for name, robust in (("held out", True), ("held out, robust off", False)):
        parameters = LocalizerParameters(robust=robust)
        every: List[Verdict] = []
        for building in BUILDINGS:
            verdicts = [judge(building, HELD_OUT_FROM + index, parameters) for index in range(count)]
            every += verdicts
            lost = 100.0 * float(np.mean([verdict.lost for verdict in verdicts]))
            yield Metric(f"{name}: {building}: drives lost", lost, "%", repeats=count)
        yield metric_of(
            f"{name}: median error of a drive", [verdict.median for verdict in every], "m", drives=len(every)
        )
        for what, shares in (
            ("scans within 0.1 m", [verdict.near for verdict in every]),
            ("scans within 0.5 m", [verdict.kept for verdict in every]),
            ("drives lost", [verdict.lost for verdict in every]),
        ):
            yield Metric(f"{name}: {what}", 100.0 * float(np.mean(shares)), "%", repeats=len(every))
