"""Where plugins run: inline for lockstep, on threads of their own under ROS, so that one that hangs stops nobody else.
"""

from __future__ import annotations

import abc
import collections
import threading
from typing import Any, Callable, Deque, Optional

READY = 2
"""Threads made before the first task: a planner's and a controller's. A new one can take a busy system its time."""


class Job:
    """A task handed to a worker; whoever started it asks whether it is done and then takes what came of it."""

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
        """Be done with an error, as where no thread can run the task."""
        self._error, self._done = error, True

    def run(self) -> None:
        """Run the task here and keep what comes of it."""
        try:
            self._value = self._task()
        except Exception as error:  # whatever a plugin raises belongs to the one who called it
            self._error = error
        except SystemExit as error:  # a plugin ends its call, not the program
            self._error = RuntimeError(f"SystemExit: {error}")
        finally:
            self._done = True


class Worker(abc.ABC):
    """Runs tasks."""

    @abc.abstractmethod
    def start(self, task: Callable[[], Any], kind: str = "") -> Job:
        """Run `task` and return at once, or when it is done where the worker is an inline one.

        Args:
            task: What to do.
            kind: The list whose plugin it calls, such as "planners", for a worker that keeps accounts.
        """


class InlineWorker(Worker):
    """Runs each task where it is started: one thread, one order, one result per seed."""

    def start(self, task: Callable[[], Any], kind: str = "") -> Job:
        """Run `task` to its end."""
        job = Job(task)
        job.run()
        return job


class ThreadWorker(Worker):
    """Runs tasks on daemon threads that wait for the next one.

    A task that hangs keeps its thread and harms no other; there are as many threads as there were tasks at one time.

    Args:
        on_done: Called on the task's thread after each one; must be quick.
    """

    def __init__(self, on_done: Callable[[], None] = lambda: None) -> None:
        self._on_done = on_done
        self._condition = threading.Condition()  # guards the two below; never held while a task runs
        self._waiting: Deque[Job] = collections.deque()
        self._idle = READY  # threads that run no task
        for _ in range(READY):
            self._start_thread()

    def start(self, task: Callable[[], Any], kind: str = "") -> Job:
        """Hand `task` to an idle thread, or to a new one; where the system has none left, it is done with an error."""
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
                if job in self._waiting:  # else a thread has come by
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
