"""The sample of BARN's worlds in lockstep, without a map and on odometry, with each controller."""

from __future__ import annotations

import os
import time
from typing import Iterator

from benchmark.metric import Metric, metric_of
from benchmark.public_data import public_data
from mbf_relay.lockstep.episodes import EpisodeJob
from mbf_relay.lockstep.result import CONTACT, TIMEOUT
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import SERVER, make_setup
from mbf_relay.lockstep.tasks import load_tasks
from mbf_relay.lockstep.workers import run


def metrics(quick: bool) -> Iterator[Metric]:
    """Drive every world with every controller and yield what came of it."""
    tasks = load_tasks(str(public_data("barn_sample.json")))[:: 6 if quick else 1]
    processes = os.cpu_count() or 1
    for entry in make_setup(config_folder(), has_map=False).settings[SERVER]["controllers"]:
        setup = make_setup(config_folder(), controller=entry["name"], has_map=False)
        start = time.perf_counter()
        results = run([EpisodeJob(task, setup, 1) for task in tasks], processes)
        wall = time.perf_counter() - start
        where = {"controller": entry["name"], "worlds": len(tasks)}
        count = len(results)
        yield Metric("worlds driven to the goal", sum(r.success for r in results), "", repeats=count, parameters=where)
        yield Metric("contacts", sum(r.outcome == CONTACT for r in results), "", repeats=count, parameters=where)
        yield Metric("out of time", sum(r.outcome == TIMEOUT for r in results), "", repeats=count, parameters=where)
        score = sum(r.score or 0.0 for r in results) / count
        yield Metric("score, mean (0.5 at best)", score, "", repeats=count, parameters=where)
        yield metric_of("time of successes", [r.time for r in results if r.success] or [float("nan")], "s", **where)
        yield metric_of("smallest clearance", [r.smallest_clearance or 0.0 for r in results], "m", **where)
        yield Metric("all of them, wall time", wall, "s", parameters={**where, "processes": processes})
        yield Metric("worlds per minute", 60.0 * count / wall, "1/min", parameters={**where, "processes": processes})
