"""A navigator on a fake clock."""

import pathlib
import sys
from typing import Callable

import pytest

sys.path.insert(0, str(pathlib.Path(__file__).parent))

import scripted  # noqa: E402
from scripted_bench import Bench  # noqa: E402


@pytest.fixture
def make_bench() -> Callable[..., Bench]:
    """Make a bench with parameters of the server's."""
    return Bench


@pytest.fixture
def bench() -> Bench:
    """A bench with everything inline."""
    return Bench()


@pytest.fixture
def held_bench() -> Bench:
    """A bench whose plugins' calls end one step later."""
    return Bench(scripted.HeldWorker())
