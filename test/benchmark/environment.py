"""The gymnasium environment: how many steps a second a policy gets, alone and with one environment per core."""

from __future__ import annotations

import os
import time
from typing import Any, Iterator

import numpy as np

from benchmark.metric import Metric, NotMeasurable, metric_of, time_call


def metrics(quick: bool) -> Iterator[Metric]:
    """Drive about in obstacle fields and yield how fast that goes."""
    try:
        from mbf_relay.lockstep.environment import NavigationEnvironment, vectorised
    except ImportError as error:
        raise NotMeasurable(str(error)) from error
    repeats, steps = (3, 100) if quick else (10, 500)
    environment = NavigationEnvironment("barn", seeds=(0, 100))
    where = {"worlds": "barn", "actions [Hz]": environment.parameters.control_rate}
    yield time_call("reset, a world built anew", environment.reset, repeats, **where)
    alone = [_steps_per_second(environment, np.zeros(2), steps) for _ in range(repeats)]
    yield metric_of("steps", alone, "1/s", **where)
    rate = float(np.median(alone)) / environment.parameters.control_rate
    yield Metric("times real time", rate, "", parameters=where)
    environment.close()
    count = os.cpu_count() or 1
    together = vectorised(count, worlds="barn", seeds=(0, 100))
    try:
        rates = [count * _steps_per_second(together, np.zeros((count, 2)), steps) for _ in range(repeats)]
    finally:
        together.close()
    yield metric_of("steps of all together", rates, "1/s", **where, environments=count)


def _steps_per_second(environment: Any, center: np.ndarray, steps: int) -> float:
    """Return steps per second of an environment that turns about and never gets far."""
    environment.reset(seed=1)
    start = time.perf_counter()
    for step in range(steps):
        environment.step(center + (0.2, 0.3) if step % 2 else center - (0.2, 0.3))
    return steps / (time.perf_counter() - start)
