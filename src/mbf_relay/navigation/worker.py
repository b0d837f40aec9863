"""Workers that run calls of plugins: inline in lockstep, on threads under ROS, so that one that hangs blocks no other.
"""

from __future__ import annotations

import abc
import collections
import threading
from typing import Any, Callable, Deque, Optional

READY = 2
"""Threads made before the first task, for a planner and a controller, since a busy system starts new ones late."""


class Job:
    """A task handed to a worker: ask `done`, then take `result`."""

    def __init__(self, task: Callable[[], Any]) -> None:
        self._task = task
        self._value: Any = None
        self._error: Optional[Exception] = None
        self._done = False  # set last, by the thread that runs it

    @property
    def done(self) -> bool:
        """Return whether the task returned or raised."""
        return self._done

    def result(self) -> Any:
        """Return what the task returned, or raise what it raised; only once it is done."""
        if not self.done:
            raise RuntimeError("the job is still running; ask `done` first")
        if self._error is not None:
            raise self._error
        return self._value

    def fail(self, error: Exception) -> None:
        """End with an error without running the task, as where no thread can be started."""
        self._error, self._done = error, True

    def run(self) -> None:
        """Run the task in this thread and keep its result or exception."""
        try:
            self._value = self._task()
        except Exception as error:  # raised again by `result`
            self._error = error
        except SystemExit as error:  # sys.exit in a plugin must not end the program
            self._error = RuntimeError(f"SystemExit: {error}")
        finally:
            self._done = True


class Worker(abc.ABC):
    """Runs tasks."""

    @abc.abstractmethod
    def start(self, task: Callable[[], Any], kind: str = "") -> Job:
        """Run `task`; return at once, or when it is done for an inline worker.

        Args:
            task: The call.
            kind: Name of the list whose plugin it calls, such as "planners"; for workers that count or time calls.
        """


class InlineWorker(Worker):
    """Runs each task in the calling thread, for results that depend on the seed only."""

    def start(self, task: Callable[[], Any], kind: str = "") -> Job:
        """Run `task` to its end."""
        job = Job(task)
        job.run()
        return job


class ThreadWorker(Worker):
    """Runs tasks on a pool of daemon threads that grows as needed.

    A task that hangs keeps its thread and delays no other. There are as many threads as there were tasks at one time,
    and at least READY.

    Args:
        on_done: Called on the task's thread after each task; must be quick.
    """

    def __init__(self, on_done: Callable[[], None] = lambda: None) -> None:
        self._on_done = on_done
        self._condition = threading.Condition()  # guards the two below; never held while a task runs
        self._waiting: Deque[Job] = collections.deque()
        self._idle = READY  # threads that run no task
        for _ in range(READY):
            self._start_thread()

    def start(self, task: Callable[[], Any], kind: str = "") -> Job:
        """Run `task` on an idle or a new thread; where no thread can be started, the job ends with RuntimeError."""
        job = Job(task)
        with self._condition:
            self._waiting.append(job)
            if self._idle >= len(self._waiting):
                self._condition.notify()
                return job
            self._idle += 1
        try:
            self._start_thread()
        except RuntimeError as error:
            with self._condition:
                self._idle -= 1
                if job in self._waiting:  # otherwise another thread has taken it
                    self._waiting.remove(job)
                    job.fail(error)
            self._on_done()
        return job

    def _start_thread(self) -> None:
        threading.Thread(target=self._loop, name="plugin", daemon=True).start()

    def _loop(self) -> None:
        while True:
            with self._condition:
                self._condition.wait_for(lambda: bool(self._waiting))
                self._idle -= 1
                job = self._waiting.popleft()
            job.run()
            with self._condition:
                self._idle += 1
            self._on_done()
