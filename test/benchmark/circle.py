"""The tutorial's circle in lockstep, with the nodes' own parameter files: how well, and how fast, it is driven."""

from __future__ import annotations

import os
import time
from typing import Iterator, List

from benchmark.metric import Metric, metric_of
from mbf_relay.lockstep.episode import Episode
from mbf_relay.lockstep.episodes import EpisodeJob
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import Setup, make_setup
from mbf_relay.lockstep.tasks import circle
from mbf_relay.lockstep.workers import run


def metrics(quick: bool) -> Iterator[Metric]:
    """Drive circles with several seeds and yield what came of it."""
    setup = make_setup(config_folder())
    seeds = list(range(1, 4 if quick else 21))
    processes = os.cpu_count() or 1
    start = time.perf_counter()
    results = run([EpisodeJob(circle(), setup, seed) for seed in seeds], processes)
    wall = time.perf_counter() - start
    yield from driving(results)
    yield Metric("circles per minute", 60.0 * len(seeds) / wall, "1/min", parameters={"processes": processes})
    yield from speed(setup, 2 if quick else 5)
    yield equality(setup, results[0])


def driving(results: List[EpisodeResult]) -> Iterator[Metric]:
    """Yield how well circles were driven."""
    seeds = {"seeds": len(results)}
    yield Metric(
        "circles with all goals reached and no contact",
        sum(r.success for r in results),
        "",
        repeats=len(results),
        parameters=seeds,
    )
    yield Metric("contacts", sum(r.contacts for r in results), "", repeats=len(results), parameters=seeds)
    done = [result for result in results if result.success] or results
    yield metric_of("time", [r.time for r in done], "s", **seeds)
    yield metric_of("path length", [r.path_length for r in done], "m", **seeds)
    yield metric_of("changes of turning side", [r.smoothness.turn_changes_per_metre for r in done], "1/m", **seeds)
    yield metric_of("acceleration, mean", [r.smoothness.mean_acceleration for r in done], "m/s2", **seeds)
    yield metric_of("jerk, mean", [r.smoothness.mean_jerk for r in done], "m/s3", **seeds)
    yield metric_of("smallest clearance", [r.smallest_clearance or 0.0 for r in done], "m", **seeds)
    yield metric_of("final error", [r.final_error for r in done], "m", **seeds)
    waits = [wait for r in done for wait in r.goal_waits]
    if waits:
        yield metric_of("within a goal's tolerance before reached", waits, "s", **seeds)
    yield metric_of("localization error, mean", [r.localization_error_mean for r in done], "m", **seeds)
    yield metric_of("localization error, max", [r.localization_error_max for r in done], "m", **seeds)


def speed(setup: Setup, repeats: int) -> Iterator[Metric]:
    """Yield how fast one core drives a circle, and where its time goes."""
    results = [Episode(circle(), setup, 1, clock=time.perf_counter).run() for _ in range(repeats)]
    rates = {"control": "10 Hz", "localization": setup.localization}
    yield metric_of("real-time factor on one core", [r.time / r.machine["wall"] for r in results], "", **rates)
    best = min(results, key=lambda result: result.machine["wall"])
    stages = dict(best.machine["stages"])
    stages["all else"] = best.machine["wall"] - sum(stages.values())
    for name, seconds in sorted(stages.items(), key=lambda item: -item[1]):
        yield Metric(f"share of time: {name}", 100.0 * seconds / best.machine["wall"], "%", parameters=rates)
    yield Metric("memory of a process", max(r.machine["memory_mib"] for r in results), "MiB", parameters=rates)


def equality(setup: Setup, driven_in_parallel: EpisodeResult) -> Metric:
    """Return whether a drive among others, in another process, is the one driven here alone: 1 to the last bit."""
    alone = Episode(circle(), setup, driven_in_parallel.seed).run()
    return Metric(
        "equal to the last bit, alone and among others", float(alone.drive() == driven_in_parallel.drive()), ""
    )
