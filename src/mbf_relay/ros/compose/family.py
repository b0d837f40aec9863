"""Child processes that are forked from a prepared process, and started again when they end."""

from __future__ import annotations

import contextlib
import math
import os
import select
import signal
import sys
import time
from typing import Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence, Set

from mbf_relay.ros.common.ending import adopt_orphans, ending_signals, interrupt_at_death_of

RESPAWN_DELAY = 1.0
"""Wall time (s) from a child's end to its successor's start, as in the launch files of single nodes."""
PATIENCE = 5.0
"""Wall time (s) from SIGINT to SIGKILL; a node ends within 2.5 s."""
ORPHANED = 0.001
"""Wall time (s) between a child's checks whether its nursery has ended and the parent has adopted it."""


class Nursery(NamedTuple):
    """A short-lived process that prepares, forks one child for each task, and ends.

    Attributes:
        names: Names of the tasks.
        births: File descriptor (read end of a pipe) to which each child writes "PID NAME".
    """

    names: List[str]
    births: int


class Family:
    """Runs each task in a process of its own, supervised by a single-threaded parent that sleeps between signals.

    An intermediate process imports what the tasks share, forks them and ends; the parent adopts them as a subreaper. If
    the intermediate process stayed, it would keep the old copy of each page that a child has since written to, a
    quarter of the shared memory. The parent imports nothing of the tasks. Where the parent is killed, its children get
    SIGINT.

    Args:
        prepare: Called in the intermediate process with the names of the tasks that it will fork.
        tasks: Functions by name; each is called in a process of its own, with exit status 0 where it returns.
        respawns: Whether a task is started again when its process has ended, with any status.
    """

    def __init__(
        self, prepare: Callable[[Sequence[str]], None], tasks: Mapping[str, Callable[[], None]], respawns: bool
    ) -> None:
        self._prepare, self._tasks, self._respawns = prepare, tasks, respawns
        self._nurseries: Dict[int, Nursery] = {}
        self._running: Dict[int, str] = {}
        self._failed = False

    def run(self) -> int:
        """Run until all processes have ended; return 0 after one of ending_signals() or if no task failed, else 1."""
        ends = ending_signals()
        if not adopt_orphans():
            _say("this system does not let a process adopt others (prctl PR_SET_CHILD_SUBREAPER), as under qemu; "
                 "start each node by itself: composed:=false")
            return 1
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ends | {signal.SIGCHLD})
        try:
            self._bear(list(self._tasks), before, 0.0)
            while self._running or self._nurseries:
                if _next_signal(ends | {signal.SIGCHLD}, math.inf) in ends:
                    self._end_all()
                    return 0
                for name in self._reap():
                    if self._respawns:
                        self._bear([name], before, time.monotonic() + RESPAWN_DELAY)
            return int(self._failed)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _bear(self, names: List[str], signals: Iterable[int], when: float) -> None:
        """Fork a nursery that starts tasks.

        Args:
            names: Names of the tasks.
            signals: Signals that the tasks have blocked.
            when: Earliest start (s, monotonic clock); they start later if the preparation takes longer.
        """
        parent = os.getpid()
        ask_for_end = interrupt_at_death_of(parent)  # before the fork: it loads a library
        births, told = os.pipe()
        sys.stdout.flush()
        sys.stderr.flush()
        nursery = os.fork()
        if nursery:
            os.close(told)
            self._nurseries[nursery] = Nursery(names, births)
            return
        status = 1
        try:
            ask_for_end()
            os.close(births)
            nursery = os.getpid()
            for number in ending_signals():  # there is nothing to clean up
                signal.signal(number, signal.SIG_DFL)
            signal.pthread_sigmask(signal.SIG_SETMASK, signals)
            self._prepare(names)
            time.sleep(max(0.0, when - time.monotonic()))
            for name in names:
                if os.fork() == 0:
                    status = self._live(name, told, nursery, parent)
                    break
            else:
                status = 0
        except SystemExit as end:
            if isinstance(end.code, str):  # an error message
                print(end.code, file=sys.stderr)
            else:
                status = int(end.code or 0)
        except BaseException:
            import traceback  # here, to keep the long-lived parent small

            traceback.print_exc()
        finally:
            sys.stdout.flush()
            os._exit(status)

    def _live(self, name: str, told: int, nursery: int, parent: int) -> int:
        """Run a task in a child that has just been forked; return its exit status.

        Args:
            name: Name of the task.
            told: File descriptor to which PID and name are written.
            nursery, parent: PIDs of the process that forked it, and of the one that adopts it.
        """
        os.write(told, f"{os.getpid()} {name}\n".encode())  # shorter than PIPE_BUF: written in one piece
        os.close(told)
        while os.getppid() == nursery:
            time.sleep(ORPHANED)
        interrupt_at_death_of(parent)()
        self._tasks[name]()
        return 0

    def _reap(self) -> List[str]:
        """Collect processes that have ended; return the names of tasks that returned, failed or were never started."""
        ended: Dict[int, int] = {}
        while True:
            try:
                child, status = os.waitpid(-1, os.WNOHANG)
            except ChildProcessError:
                break
            if not child:
                break
            ended[child] = status
        gone: List[str] = []
        for child in [child for child in ended if child in self._nurseries]:  # first: their children may have ended too
            for name in self._take_births(self._nurseries.pop(child)):
                self._tell(name, ended[child] or 1)
                gone.append(name)
        for child, status in ended.items():
            name = self._running.pop(child, "")  # empty for an adopted descendant of a child
            if name:
                self._tell(name, status)
                gone.append(name)
        return gone

    def _take_births(self, nursery: Nursery) -> List[str]:
        """Register the children of a nursery that has ended; return the names of tasks that were never forked."""
        with os.fdopen(nursery.births, "rb") as stream:
            lines = stream.read().decode().splitlines()
        missing = list(nursery.names)
        for line in lines:
            pid, name = line.split()
            self._running[int(pid)] = name
            missing.remove(name)
        return missing

    def _tell(self, name: str, status: int) -> None:
        self._failed |= status != 0
        if self._respawns:
            _say(f"{name} ended {_describe(status)}; it starts again")
        elif status:
            _say(f"{name} ended {_describe(status)}")

    def _end_all(self) -> None:
        self._respawns = False
        for nursery in list(self._nurseries):
            os.kill(nursery, signal.SIGKILL)
            os.waitpid(nursery, 0)
            self._take_births(self._nurseries.pop(nursery))
        for child in self._running:
            os.kill(child, signal.SIGINT)
        end_time = time.monotonic() + PATIENCE
        while self._running:
            if _next_signal({signal.SIGCHLD}, end_time) is None:
                for child in self._running:
                    os.kill(child, signal.SIGKILL)
                end_time = math.inf
            self._reap()


def _next_signal(numbers: Set[signal.Signals], end_time: float) -> Optional[int]:
    """Wait for one of the signals until `end_time` (s, monotonic clock); return its number, None at the time's end."""
    if end_time == math.inf:
        return signal.sigwaitinfo(numbers).si_signo
    found = signal.sigtimedwait(numbers, max(0.0, end_time - time.monotonic()))
    return None if found is None else found.si_signo


def _say(text: str) -> None:
    """Write a line to stderr unless that would block, which would keep this process from restarting tasks.

    It is written directly, since text in Python's buffer could block later, when the buffer is flushed before a fork.
    """
    terminal = select.poll()
    terminal.register(sys.stderr.fileno(), select.POLLOUT)
    with contextlib.suppress(OSError):
        if [event for _, event in terminal.poll(0)] == [select.POLLOUT]:
            os.write(sys.stderr.fileno(), f"{text}\n".encode())


def _describe(status: int) -> str:
    """Return in words how a process ended, from the status of waitpid."""
    if os.WIFSIGNALED(status):
        return f"by signal {os.WTERMSIG(status)}"
    return f"with status {os.WEXITSTATUS(status)}"
