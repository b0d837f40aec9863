"""How fast this machine is by itself, so that metrics taken on two machines can be compared.

Three things that no change of the package touches: plain Python, one compiled loop, one copy of memory.
"""

from __future__ import annotations

from typing import Iterator

import numpy as np

from benchmark.metric import Metric, time_call
from mbf_relay.kernels import kernel

ROUNDS = 1_000_000
"""Of both loops."""
COPIED = 64 * 2**20
"""Bytes that are copied: more than caches hold."""


@kernel("float64(int64)")
def _logistic(rounds: int) -> float:
    x = 0.3
    for _ in range(rounds):
        x = 3.7 * x * (1.0 - x)
    return x


def _plain(rounds: int) -> float:
    x = 0.3
    for _ in range(rounds):
        x = 3.7 * x * (1.0 - x)
    return x


def metrics(quick: bool) -> Iterator[Metric]:
    """Yield the time of each."""
    repeats = 5 if quick else 25
    source = np.ones(COPIED, dtype=np.uint8)
    target = np.empty_like(source)
    yield time_call("plain Python, a million rounds", lambda: _plain(ROUNDS), repeats, "ms")
    yield time_call("compiled loop, a million rounds", lambda: _logistic(ROUNDS), repeats, "ms")
    yield time_call("copy of 64 MiB", lambda: np.copyto(target, source), repeats, "ms")
