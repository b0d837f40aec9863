"""Processes forked from one that has prepared what they share, and forked anew where they end."""

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
"""Wall time (s) children get to end in; a node ends itself within 2.5 s."""
ORPHANED = 0.001
"""Wall time (s) between two looks of a child whether it is the family's: the one who forked it ends when all are there.
"""


class Nursery(NamedTuple):
    """A process that prepares, forks children and ends.

    Attributes:
        names: Of the tasks they are to do.
        births: File descriptor; each child writes its process's number there, and the task's name.
    """

    names: List[str]
    births: int


class Family:
    """One process for each task, and a parent that watches them, with one thread that sleeps until something happens.

    What the tasks have in common is prepared by a process that forks them and ends: it would go on holding all that
    each of its children has since written to, a quarter of what they share. The parent, which adopts them, has prepared
    nothing, and does nothing of its own that could fail with a child. Where it is killed itself, its children end as by
    Ctrl-C.

    Args:
        prepare: Called in a process of its own, with the names of the tasks that are then begun.
        tasks: By name; each is called in a process of its own, whose exit status is 0 where it returns.
        respawns: Whether a task is begun anew where its process ended, for whatever reason.
    """

    def __init__(
        self, prepare: Callable[[Sequence[str]], None], tasks: Mapping[str, Callable[[], None]], respawns: bool
    ) -> None:
        self._prepare, self._tasks, self._respawns = prepare, tasks, respawns
        self._nurseries: Dict[int, Nursery] = {}
        self._running: Dict[int, str] = {}
        self._failed = False

    def run(self) -> int:
        """Return the exit status once all have ended: 0 after a signal, or where all returned; else 1."""
        ends = ending_signals()
        adopt_orphans()
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
        """Begin tasks at a time (s, monotonic), or as soon as what they need is prepared, with these signals blocked.
        """
        parent = os.getpid()
        ask_for_end = interrupt_at_death_of(parent)  # before there is a child: it loads a library
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
            for number in ending_signals():  # there is nothing to clean up, nor to tell of
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
            if isinstance(end.code, str):  # it says why
                print(end.code, file=sys.stderr)
            else:
                status = int(end.code or 0)
        except BaseException:
            import traceback  # the parent, which lives as long as its children, needs none

            traceback.print_exc()
        finally:
            sys.stdout.flush()
            os._exit(status)

    def _live(self, name: str, told: int, nursery: int, parent: int) -> int:
        """Do a task and return its exit status, as a child that has just been forked.

        Args:
            name: The task's.
            told: File descriptor to tell of it.
            nursery, parent: Processes: who forked it, and who adopts it then.
        """
        os.write(told, f"{os.getpid()} {name}\n".encode())  # shorter than what the system writes in one piece
        os.close(told)
        while os.getppid() == nursery:
            time.sleep(ORPHANED)
        interrupt_at_death_of(parent)()
        self._tasks[name]()
        return 0

    def _reap(self) -> List[str]:
        """Take note of who has ended and return the names of tasks that have: done, failed or never begun."""
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
        for child in [child for child in ended if child in self._nurseries]:  # first: whom they bore may be among them
            for name in self._take_births(self._nurseries.pop(child)):
                self._tell(name, ended[child] or 1)
                gone.append(name)
        for child, status in ended.items():
            name = self._running.pop(child, "")  # none of those that a child has left behind
            if name:
                self._tell(name, status)
                gone.append(name)
        return gone

    def _take_births(self, nursery: Nursery) -> List[str]:
        """Take over the children of a nursery that has ended; returns the names of those that were never born."""
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
    """Return the first signal to come until `end_time` (s, monotonic); None where none does."""
    if end_time == math.inf:
        return signal.sigwaitinfo(numbers).si_signo
    found = signal.sigtimedwait(numbers, max(0.0, end_time - time.monotonic()))
    return None if found is None else found.si_signo


def _say(text: str) -> None:
    """Write a line to the terminal, where it takes one: who waited for it would start nothing again.

    There is no other thread to wait for it, since who forks has one alone; and what comes by others' hands, such as
    Python's own buffer, could be waited for at the next fork.
    """
    terminal = select.poll()
    terminal.register(sys.stderr.fileno(), select.POLLOUT)
    with contextlib.suppress(OSError):
        if [event for _, event in terminal.poll(0)] == [select.POLLOUT]:
            os.write(sys.stderr.fileno(), f"{text}\n".encode())


def _describe(status: int) -> str:
    """Return how a process ended by what waitpid says."""
    if os.WIFSIGNALED(status):
        return f"by signal {os.WTERMSIG(status)}"
    return f"with status {os.WEXITSTATUS(status)}"
