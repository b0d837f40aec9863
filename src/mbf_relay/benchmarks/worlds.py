"""The sample of BARN's worlds in lockstep, without a map and on odometry, with each controller."""

from __future__ import annotations

import os
import time
from typing import Iterator

from mbf_relay.benchmarks.figure import Figure, figure_of
from mbf_relay.benchmarks.public_data import public_data
from mbf_relay.lockstep.batch import run
from mbf_relay.lockstep.result import CONTACT, TIMEOUT
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import SERVER, make_setup
from mbf_relay.lockstep.tasks import load_tasks


def figures(quick: bool) -> Iterator[Figure]:
    """Drive every world with every controller and yield what came of it."""
    tasks = load_tasks(str(public_data("barn_sample.json")))[:: 6 if quick else 1]
    processes = os.cpu_count() or 1
    for entry in make_setup(config_folder(), has_map=False).settings[SERVER]["controllers"]:
        setup = make_setup(config_folder(), controller=entry["name"], has_map=False)
        start = time.perf_counter()
        results = run([(task, setup, 1) for task in tasks], processes)
        wall = time.perf_counter() - start
        where = {"controller": entry["name"], "worlds": len(tasks)}
        count = len(results)
        yield Figure("worlds driven to the goal", sum(r.success for r in results), "", repeats=count, parameters=where)
        yield Figure("contacts", sum(r.outcome == CONTACT for r in results), "", repeats=count, parameters=where)
        yield Figure("out of time", sum(r.outcome == TIMEOUT for r in results), "", repeats=count, parameters=where)
        score = sum(r.score or 0.0 for r in results) / count
        yield Figure("score, mean (0.5 at best)", score, "", repeats=count, parameters=where)
        yield figure_of("time of successes", [r.time for r in results if r.success] or [float("nan")], "s", **where)
        yield figure_of("smallest clearance", [r.smallest_clearance or 0.0 for r in results], "m", **where)
        yield Figure("all of them, wall time", wall, "s", parameters={**where, "processes": processes})
        yield Figure("worlds per minute", 60.0 * count / wall, "1/min", parameters={**where, "processes": processes})
