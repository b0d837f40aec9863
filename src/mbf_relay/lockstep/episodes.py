"""Driving many episodes, in this process or on a cluster, as independent pieces of work."""

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
    """An episode to drive: its task, its setup and its seed."""

    task: EpisodeTask
    setup: Setup
    seed: int


class Lost(Exception):
    """A piece of work ended without a result; the text says why."""


class Hung(BaseException):
    """Raised in work that computes for too long; a BaseException, so that no plugin's `except Exception` catches it."""


class Workers(Protocol):
    """Something that runs pieces of work: InProcess, or a DaskCluster."""

    def run(
        self, call: Callable[[Argument], Any], arguments: Sequence[Argument], time_limit: float
    ) -> Iterator[Tuple[Argument, Any]]:
        """Yield each argument when its call has ended, with the value returned, or a Lost.

        Args:
            call: A function at the top level of a module, as it is pickled by name for other processes.
            arguments: The argument of each call.
            time_limit: Seconds of CPU time after which a call counts as hung.
        """
        ...


class InProcess:
    """Runs the calls in this process, one after another, as a debugger needs it."""

    def run(
        self, call: Callable[[Argument], Any], arguments: Sequence[Argument], time_limit: float
    ) -> Iterator[Tuple[Argument, Any]]:
        """Yield each argument with its result; see Workers. A crash of the process ends all."""
        for argument in arguments:
            try:
                with _computing_limited_to(time_limit):
                    kind, content = driver.answer(driver.packed(call, argument))
                yield argument, value_of((kind, content))
            except Hung:
                yield argument, Lost(f"hung: no result within {time_limit:g} s of computing")


def value_of(answer: driver.Answer) -> Any:
    """Return the value in a driver's answer, or a Lost with its text."""
    kind, content = answer
    # trusted: written by our own process
    return pickle.loads(content) if kind == driver.DONE else Lost(content.decode())  # noqa: S301  # nosec B301


def drive(job: EpisodeJob) -> EpisodeResult:
    """Drive one episode; where that raises ValueError, return a failed result with the error's text."""
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
    """Yield each episode with its result as it ends, with a failed one where the work was lost."""
    for job, result in workers.run(drive, jobs, time_limit):
        yield job, job.task.failed(job.seed, str(result)) if isinstance(result, Lost) else result


@contextmanager
def _computing_limited_to(seconds: float) -> Iterator[None]:
    """Raise Hung in the `with` block after so many seconds of CPU time; without effect outside of the main thread."""
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
