"""Work in several processes: a worker that dies costs the one task it held, and an interrupt costs nothing finished."""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
import traceback
from collections import deque
from contextlib import contextmanager
from multiprocessing import connection
from typing import Any, Callable, Deque, Dict, Generic, Iterator, Mapping, Optional, Sequence, Tuple, TypeVar

Task = TypeVar("Task")
Result = TypeVar("Result")


ONE_THREAD = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")}
"""Each process gets one core: threads of libraries would fight over them, and add up in an order of their own."""


class Lost(Exception):
    """A task ended without a result; the text says how."""


class _Worker:
    """A process and the two ends of the pipe to it."""

    def __init__(self, context: Any, call: Callable[[Any], Any]) -> None:
        self.pipe, theirs = context.Pipe()
        self.process = context.Process(target=_serve, args=(theirs, call), daemon=True)
        with _environment(ONE_THREAD):
            self.process.start()
        theirs.close()
        self.task: Any = None
        self.since = 0.0

    def give(self, task: Any, now: float) -> None:
        """Send a task; where the process has died meanwhile, the answer will say so."""
        self.task, self.since = task, now
        try:
            self.pipe.send(task)
        except OSError:
            pass

    def end(self) -> None:
        """End the process at once."""
        self.pipe.close()
        self.process.terminate()
        self.process.join(2.0)
        if self.process.is_alive():
            self.process.kill()
            self.process.join()


class Pool(Generic[Task, Result]):
    """Runs `call` on every task in up to `jobs` processes, each started afresh (spawn), so that none inherits state."""

    def __init__(
        self, call: Callable[[Task], Result], jobs: int, time_limit: float,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        """Make a pool; the processes start with the first task.

        Args:
            call: A function at the top level of a module, as it goes to other processes by name.
            jobs: Number of processes, 1 or more.
            time_limit: Seconds of `clock` after which a task counts as hung and its process is ended.
            clock: Tells the time (s).
        """
        if jobs < 1:
            raise ValueError(f"--jobs is {jobs}; it must be at least 1")
        self._call = call
        self._jobs = jobs
        self._time_limit = time_limit
        self._clock = clock

    def run(self, tasks: Sequence[Task]) -> Iterator[Tuple[Task, Optional[Result], Optional[Lost]]]:
        """Yield each task as it ends, with its result, or with how it was lost.

        Closing the generator (or an exception in the loop over it, such as KeyboardInterrupt) ends the processes.
        """
        context = multiprocessing.get_context("spawn")
        waiting: Deque[Task] = deque(tasks)
        workers: Dict[Any, _Worker] = {}
        try:
            while waiting or workers:
                while waiting and len(workers) < self._jobs:
                    worker = _Worker(context, self._call)
                    workers[worker.pipe] = worker
                    worker.give(waiting.popleft(), self._clock())
                for pipe in connection.wait(list(workers), timeout=1.0):
                    worker = workers[pipe]
                    task = worker.task
                    result, lost = _collect(worker)
                    if lost is None and waiting:
                        worker.give(waiting.popleft(), self._clock())
                    else:
                        workers.pop(pipe).end()
                    yield task, result, lost
                for worker in self._hung(workers):
                    workers.pop(worker.pipe).end()
                    yield worker.task, None, Lost(f"hung: no result within {self._time_limit:.0f} s of wall time")
        finally:
            for worker in workers.values():
                worker.end()

    def _hung(self, workers: Dict[Any, _Worker]) -> Sequence[_Worker]:
        now = self._clock()
        return [worker for worker in workers.values() if now - worker.since > self._time_limit]


@contextmanager
def _environment(values: Mapping[str, str]) -> Iterator[None]:
    """Set variables of the environment for a while, for the processes started meanwhile."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _collect(worker: _Worker) -> Tuple[Any, Optional[Lost]]:
    try:
        succeeded, value = worker.pipe.recv()
    except (EOFError, OSError):
        worker.process.join(2.0)
        return None, Lost(f"the process died ({_how_it_died(worker.process.exitcode)})")
    return (value, None) if succeeded else (None, Lost(value))


def _how_it_died(code: Optional[int]) -> str:
    if code is None or code >= 0:
        return f"exit status {code}"
    return f"signal {signal.Signals(-code).name}"


def _serve(pipe: Any, call: Callable[[Any], Any]) -> None:
    """Answer tasks until the other end is gone; the parent alone answers interrupts."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        try:
            task = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            answer = True, call(task)
        except Exception as error:  # whatever a plugin throws must not end the batch
            last = traceback.extract_tb(error.__traceback__)[-1]
            answer = False, f"{type(error).__name__}: {error} ({last.name}, line {last.lineno})"
        try:
            pipe.send(answer)
        except (BrokenPipeError, OSError):
            return
