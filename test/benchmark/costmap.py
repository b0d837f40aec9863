"""Costmaps: inflation of whole maps, and one update of a burger's local and global costmap."""

from __future__ import annotations

import dataclasses
import math
from typing import Iterator

import numpy as np

from benchmark.arena import START, arena_map, server_parameters
from benchmark.metric import Metric, time_call
from mbf_relay.costmap import factory, inflation_kernels
from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.costmap.costmap import Costmap
from mbf_relay.costmap.inflation_layer import cost_table
from mbf_relay.costmap.observation import observation_from_scan
from mbf_relay.geometry import Pose2D
from mbf_relay.scan import LaserScan

SCALES = (1, 4, 10)
BEAMS = 360


def metrics(quick: bool) -> Iterator[Metric]:
    """Yield the times of inflation and of updates."""
    occupied = (arena_map().data == 100).astype(np.uint8) * np.uint8(LETHAL)
    table, radius = cost_table(1.0, 3.0, 0.051, 0.05)
    for scale in SCALES[:2] if quick else SCALES:
        costs = np.ascontiguousarray(np.repeat(np.repeat(occupied, scale, axis=0), scale, axis=1))
        height, width = costs.shape
        work = costs.copy()

        def inflate(costs: np.ndarray = costs, work: np.ndarray = work) -> None:
            np.copyto(work, costs)
            inflation_kernels.inflate(work, 0, 0, work.shape[1], work.shape[0], table, radius, False)

        yield time_call(
            f"inflate {width} x {height}, copy of the map included",
            inflate,
            10 if quick else 50,
            "ms",
            2,
            radius_m=1.0,
            resolution_m=0.05,
            lethal_cells=int((costs == LETHAL).sum()),
        )
    for name in ("local_costmap", "global_costmap"):
        yield _update(name, 20 if quick else 300)


def _update(name: str, repeats: int) -> Metric:
    """Return the time from a scan to the snapshot that shows it, the robot driving and the scan noisy."""
    parameters = server_parameters()
    costmap = factory.build_costmap(name, parameters[name], parameters)
    if not costmap.parameters.rolling_window:
        costmap.set_map(arena_map())
    rng = np.random.default_rng(0)
    scans = [_scan(rng, step) for step in range(32)]
    costmap.update(0.0, START)
    step = [0]

    def update() -> None:
        step[0] += 1
        pose = Pose2D(START.x + 0.02 * (step[0] % 50), START.y, 0.01 * step[0])
        _observe(costmap, scans[step[0] % len(scans)], pose, 0.1 * step[0])
        costmap.snapshot()

    grid = costmap.snapshot().grid
    return time_call(
        f"update of the {name.replace('_', ' ')}", update, repeats, "ms", 5, cells=f"{grid.width} x {grid.height}",
        beams=BEAMS, inflation_radius_m=parameters[name]["inflation_radius"])


def _scan(rng: np.random.Generator, step: int) -> LaserScan:
    angles = 2.0 * math.pi * np.arange(BEAMS) / BEAMS
    ranges = 1.2 + 0.6 * np.sin(3.0 * angles + 0.1 * step) + rng.normal(0.0, 0.01, BEAMS)
    ranges[rng.random(BEAMS) < 0.1] = np.inf
    return LaserScan(ranges, 0.0, 2.0 * math.pi / BEAMS, 0.12, 3.5, 0.0)


def _observe(costmap: Costmap, scan: LaserScan, pose: Pose2D, now: float) -> None:
    scan = dataclasses.replace(scan, stamp=now)  # of an old one nothing is tracked
    costmap.observe("scan", observation_from_scan(scan, pose), now)
    costmap.update(now, pose)
