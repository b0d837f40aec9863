"""What Dask costs beside the driving, and how many cores one scheduler can keep busy."""

from __future__ import annotations

import os
import pickle  # what is measured is its size
import time
from typing import Any, Iterator, List, Sequence, Tuple

from benchmark.metric import Metric, NotMeasurable, metric_of
from mbf_relay.lockstep import driver
from mbf_relay.lockstep.episodes import EpisodeJob, drive
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import make_setup
from mbf_relay.lockstep.sources import sources
from mbf_relay.lockstep.tasks import circle
from mbf_relay.lockstep.workers import workers_for

CORES = (10, 100, 1000)
LONG = 60.0
"""Seconds of computing nothing here takes."""


def metrics(quick: bool) -> Iterator[Metric]:
    """Start a cluster of this machine's cores, give it empty work and circles, and yield what that took."""
    processes, pieces, laps = os.cpu_count() or 1, 200 if quick else 2000, 2 if quick else 8
    job = EpisodeJob(circle(), make_setup(config_folder()), 1)
    start = time.perf_counter()
    try:
        with workers_for(pieces, max(2, processes), say=lambda line: None) as workers:
            first = next(iter(workers.run(nothing, [0], LONG)))
            yield Metric("start until the first result", time.perf_counter() - start, "s", parameters={
                "processes": processes})
            assert first == (0, 0)
            rates = [_rate(workers, list(range(pieces))) for _ in range(5)]
            yield metric_of("empty pieces of work", rates, "1/s", processes=processes)
            _circles(workers, job, processes)  # each process has to import everything first
            seconds, result = _circles(workers, job, laps)
            seconds *= processes
            yield Metric("time of a circle on one core", seconds, "s", repeats=laps, parameters={
                "processes": processes})
            sent, back = driver.packed(drive, job, sources([])), pickle.dumps(result, protocol=4)
            yield Metric("sent per circle", len(sent) / 1024.0, "KiB")
            yield Metric("sent back per circle", len(back) / 1024.0, "KiB")
            rates = [_rate(workers, [(job, result)] * (pieces // 4)) for _ in range(5)]
            ceiling = metric_of("pieces as large as a circle, there and back", rates, "1/s", processes=processes)
            yield ceiling
    except ValueError as error:
        raise NotMeasurable(str(error)) from error
    yield Metric("cores that one scheduler keeps busy with circles", ceiling.value * seconds, "")
    for cores in CORES:
        rate = min(cores / seconds, ceiling.value)
        yield Metric("circles per minute, reckoned from the above", 60.0 * rate, "1/min", parameters={"cores": cores})


def nothing(argument: Any) -> Any:
    """Return the last part of the argument."""
    return argument[-1] if isinstance(argument, tuple) else argument


def _rate(workers: Any, arguments: Sequence[Any]) -> float:
    """Return pieces of work per second."""
    start = time.perf_counter()
    done: Sequence[Any] = list(workers.run(nothing, arguments, LONG))
    assert len(done) == len(arguments)
    return len(arguments) / (time.perf_counter() - start)


def _circles(workers: Any, job: EpisodeJob, count: int) -> Tuple[float, EpisodeResult]:
    """Return seconds of the clock per circle, and one of the results."""
    jobs: List[EpisodeJob] = [job._replace(seed=seed) for seed in range(1, count + 1)]
    start = time.perf_counter()
    results = [result for _, result in workers.run(drive, jobs, 15.0 * LONG)]
    seconds = (time.perf_counter() - start) / count
    lost = [result for result in results if not isinstance(result, EpisodeResult)]
    if lost:
        raise ValueError(str(lost[0]))
    return seconds, results[0]
