"""Processes forked from one parent, and forked anew where they end."""

from __future__ import annotations

import math
import os
import signal
import sys
import time
import traceback
from typing import Callable, Dict, Iterable, Mapping, Optional, Set

from mbf_relay.ros.common.ending import interrupt_at_death_of

RESPAWN_DELAY = 1.0
"""Wall time (s) from a child's end to its successor's start, as in the launch files of single nodes."""
PATIENCE = 5.0
"""Wall time (s) children get to end in; a node ends itself within 2.5 s."""
ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Family:
    """One process for each task. The parent has one thread, which sleeps until a child ends or a signal comes.

    It does nothing of its own that could fail with a child; where it is killed itself, its children end as by Ctrl-C.

    Args:
        tasks: By name; each is called in a process of its own, whose exit status is 0 where it returns.
        respawns: Whether a task is begun anew where its process ended, for whatever reason.
    """

    def __init__(self, tasks: Mapping[str, Callable[[], None]], respawns: bool) -> None:
        self._tasks, self._respawns = tasks, respawns
        self._running: Dict[int, str] = {}
        self._due: Dict[str, float] = {}
        self._failed = False

    def run(self) -> int:
        """Return the exit status once all have ended: 0 after a signal, or where all returned; else 1."""
        ends = {number for number in ENDINGS if signal.getsignal(number) is not signal.SIG_IGN}  # nohup
        before = signal.pthread_sigmask(signal.SIG_BLOCK, ends | {signal.SIGCHLD})
        try:
            for name in self._tasks:
                self._fork(name, before)
            while self._running or self._due:
                if _next_signal(ends | {signal.SIGCHLD}, min(self._due.values(), default=math.inf)) in ends:
                    self._end_all()
                    return 0
                self._reap()
                now = time.monotonic()
                for name in [name for name, due in self._due.items() if due <= now]:
                    del self._due[name]
                    self._fork(name, before)
            return int(self._failed)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def _fork(self, name: str, signals: Iterable[int]) -> None:
        ask_for_end = interrupt_at_death_of(os.getpid())
        sys.stdout.flush()
        sys.stderr.flush()
        child = os.fork()
        if child:
            self._running[child] = name
            return
        status = 1
        try:
            ask_for_end()
            signal.pthread_sigmask(signal.SIG_SETMASK, signals)
            self._tasks[name]()
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            sys.stdout.flush()
            os._exit(status)

    def _reap(self) -> None:
        for child in list(self._running):
            ended, status = os.waitpid(child, os.WNOHANG)
            if not ended:
                continue
            name = self._running.pop(child)
            self._failed |= status != 0
            if self._respawns:
                print(f"{name} ended {_describe(status)}; it starts again", file=sys.stderr, flush=True)
                self._due[name] = time.monotonic() + RESPAWN_DELAY
            elif status:
                print(f"{name} ended {_describe(status)}", file=sys.stderr, flush=True)

    def _end_all(self) -> None:
        self._respawns = False
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


def _describe(status: int) -> str:
    """Return how a process ended by what waitpid says."""
    if os.WIFSIGNALED(status):
        return f"by signal {os.WTERMSIG(status)}"
    return f"with status {os.WEXITSTATUS(status)}"
