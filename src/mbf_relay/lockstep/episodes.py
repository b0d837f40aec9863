"""Many episodes: as pieces of work, in this process or on a cluster."""

from __future__ import annotations

import pickle  # nosec B403
import signal
import threading
import time
from contextlib import contextmanager
from typing import Any, Callable, Iterator, NamedTuple, Optional, Protocol, Sequence, Tuple, TypeVar

from mbf_relay.lockstep import driver
from mbf_relay.lockstep.episode import Episode
from mbf_relay.lockstep.memory import give_back, spare_what_stays
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.setup import Setup
from mbf_relay.lockstep.tasks import EpisodeTask

Argument = TypeVar("Argument")


class EpisodeJob(NamedTuple):
    """An episode to drive: where, how, and the seed of all chance."""

    task: EpisodeTask
    setup: Setup
    seed: int


class Lost(Exception):
    """A piece of work ended without a result; the text says how."""


class Hung(BaseException):
    """Thrown into work that computes for too long; no plugin's `except Exception` keeps it."""


class Workers(Protocol):
    """Where work is done."""

    def run(
        self, call: Callable[[Argument], Any], arguments: Sequence[Argument], time_limit: float
    ) -> Iterator[Tuple[Argument, Any]]:
        """Yield each argument as its work ends, with what `call` returned, or Lost.

        Args:
            call: A function at the top level of a module, as it goes to other processes by name.
            arguments: Of one call each.
            time_limit: Seconds of computing after which a call counts as hung.
        """
        ...


class InProcess:
    """Works here, one after another: nothing to start, nothing to send, and a debugger sees all of it."""

    def run(
        self, call: Callable[[Argument], Any], arguments: Sequence[Argument], time_limit: float
    ) -> Iterator[Tuple[Argument, Any]]:
        """Yield each argument and what came of it; see Workers. A crash of the process ends everything."""
        for argument in arguments:
            try:
                with _computing_limited_to(time_limit):
                    kind, content = driver.answer(driver.packed(call, argument))
                yield argument, value_of((kind, content))
            except Hung:
                yield argument, Lost(f"hung: no result within {time_limit:g} s of computing")


def value_of(answer: driver.Answer) -> Any:
    """Return what a driver's answer holds: a value, or Lost with its text."""
    kind, content = answer
    # of our own making, not from outside
    return pickle.loads(content) if kind == driver.DONE else Lost(content.decode())  # noqa: S301  # nosec B301


def drive(job: EpisodeJob) -> EpisodeResult:
    """Drive one episode. What cannot be driven is a failed result that says why."""
    spare_what_stays()
    try:
        return Episode(job.task, job.setup, job.seed, clock=time.perf_counter).run()
    except ValueError as error:
        return job.task.failed(job.seed, str(error))
    finally:
        give_back()


def drive_all(
    jobs: Sequence[EpisodeJob], workers: Workers, time_limit: float
) -> Iterator[Tuple[EpisodeJob, EpisodeResult]]:
    """Yield each episode as it ends; what was lost is a failed result that says how."""
    for job, result in workers.run(drive, jobs, time_limit):
        yield job, job.task.failed(job.seed, str(result)) if isinstance(result, Lost) else result


@contextmanager
def _computing_limited_to(seconds: float) -> Iterator[None]:
    """Throw Hung into what computes longer; only a process's main thread can be interrupted so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(_number: int, _frame: Optional[Any]) -> None:
        raise Hung

    before = signal.signal(signal.SIGPROF, interrupt)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)
