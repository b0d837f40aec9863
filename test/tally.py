"""What the proofs tried, and what they lost: told trial by trial, counted by `scripts/benchmark reliability`.

A proof is a test whose trials are few in the usual suite and as many as its claim asks for under `--long`. It takes
their number from `how_many` and makes each within `trial`.
"""

import contextlib
import json
import os
import unittest
from pathlib import Path
from typing import Iterator, List, NamedTuple

LONG = os.environ.get("MBF_RELAY_LONG") == "1"
FILE = "trials.jsonl"
"""In the results folder of a job: one line a trial."""


class Measured(NamedTuple):
    """A figure of one trial."""

    name: str
    value: float
    unit: str


class Trial(NamedTuple):
    """One trial: of what, whether it was lost, and what was measured."""

    what: str
    lost: bool
    measured: List[Measured]

    def measure(self, name: str, value: float, unit: str) -> None:
        """Note a figure."""
        self.measured.append(Measured(name, value, unit))


def how_many(usual: int, long: int) -> int:
    """Return the number of trials to make."""
    return max(usual, round(long * share())) if LONG else usual


def share() -> float:
    """Return the share, 0 to 1, of the long trials that MBF_RELAY_SHARE asks for."""
    return float(os.environ.get("MBF_RELAY_SHARE", "1"))


@contextlib.contextmanager
def trial(what: str) -> Iterator[Trial]:
    """Make one trial: lost where an exception leaves it, which goes on to the test.

    What is skipped, or broken off by no Exception, as by Ctrl-C or by hypothesis that draws no further, is none.
    """
    made = Trial(what, False, [])
    try:
        yield made
    except unittest.SkipTest:
        raise
    except Exception:
        _tell(made._replace(lost=True))
        raise
    _tell(made)


def _tell(made: Trial) -> None:
    folder = os.environ.get("MBF_RELAY_TEST_RESULTS")
    if folder:
        with open(os.path.join(folder, FILE), "a", encoding="utf-8") as stream:
            stream.write(json.dumps(made) + "\n")


def read_trials(folder: Path) -> List[Trial]:
    """Return the trials told of in a job's results folder."""
    path = folder / FILE
    if not path.exists():
        return []
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return [Trial(what, lost, [Measured(*each) for each in measured]) for what, lost, measured in lines]
