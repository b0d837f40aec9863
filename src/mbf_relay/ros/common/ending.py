"""Signals that end a node, taken by a thread that does nothing else.

A signal handler runs in the middle of whatever the main thread does: of an import, which then ends in a traceback, or
of a registration, whose locks rospy's shutdown waits for within the handler, for ever. So signals are blocked in every
thread, and one waits for them. It ends the node as it would end by itself, while all others finish what they are at;
and where somebody never finishes, as with a master that hangs, it ends the process without. Nothing here imports ROS: a
node can be ended while it still imports.
"""

from __future__ import annotations

import atexit
import os
import signal
import sys
import threading
import time
from typing import Callable, Optional, Set

from mbf_relay.memory import hold_little

PATIENCE = 2.5
"""Wall seconds a node gets for its last words and its goodbye to the master."""


def open_standard_streams() -> None:
    """Lead what was closed by whoever started this process nowhere; before anything else is opened.

    Python has None in its place, on which each line of the log fails, and the next file or connection would be taken
    for the terminal by whatever writes there.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, os.fdopen(number, mode, closefd=False))


def ending_signals() -> Set[signal.Signals]:
    """Return which signals end a process: a hang-up not under nohup, an interrupt in the background of a script, too.

    A shell has that ignored, so that a Ctrl-C does not reach it; but it is what roslaunch ends a node with.
    """
    numbers = {signal.SIGINT, signal.SIGTERM}
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.add(signal.SIGHUP)
    return numbers


class NodeEnding:
    """The end of this process; make it first of all, in the main thread.

    Args:
        interrupted: Exit status where a signal ends it.

    Attributes:
        begun: Whether a signal has come.
    """

    def __init__(self, interrupted: int = 0) -> None:
        self._numbers = numbers = ending_signals()
        signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
        open_standard_streams()
        self.interrupted = interrupted
        self._lock = threading.Lock()
        self._shut_down: Optional[Callable[[str], None]] = None
        self._done = threading.Event()
        self.begun = False
        hold_little()  # before the first thread, whose arena would stay; what this imports no signal can interrupt
        waiting = threading.Thread(target=self._wait, name="ending", daemon=True)
        waiting.start()
        for number in numbers:  # may reach a thread that a library started before: it passes them on
            signal.signal(number, lambda number, _frame: signal.pthread_kill(waiting.ident or 0, number))

    def use(self, shut_down: Callable[[str], None]) -> None:
        """Have `shut_down` called with a reason when a signal comes; until now the process just ended."""
        with self._lock:
            self._shut_down = shut_down

    def leave(self, status: int) -> None:
        """End the process, after a shutdown that has begun is done, and libraries have cleaned up.

        What else Python does at its end is left out: threads of C++ libraries still run then, and crash now and then.
        """
        if self.begun:
            self._done.wait(PATIENCE)
        threading.Thread(target=self._end_anyway, args=(status,), name="late leave", daemon=True).start()
        atexit._run_exitfuncs()  # folders in /tmp, above all: rosbag makes one for each bag it reads
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (OSError, ValueError):
                pass
        os._exit(status)

    def _wait(self) -> None:
        number = signal.sigwait(self._numbers)
        with self._lock:
            self.begun = True
            shut_down = self._shut_down
        if shut_down is None:
            os._exit(self.interrupted)
        threading.Thread(target=self._end_anyway, args=(self.interrupted,), name="late ending", daemon=True).start()
        shut_down(f"signal {int(number)}")
        self._done.set()

    def _end_anyway(self, status: int) -> None:
        time.sleep(PATIENCE)
        os._exit(status)


def interrupt_at_death_of(parent: int) -> Callable[[], None]:
    """Return what a child does first: ask for a SIGINT when its parent dies, however it dies (Linux: prctl(2)).

    A shell has what a script starts with `&` ignore SIGINT, and all that this starts: the child does not.
    """
    import ctypes

    set_parent_death_signal = 1
    prctl = ctypes.CDLL(None, use_errno=True).prctl

    def ask() -> None:
        if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
            signal.signal(signal.SIGINT, signal.SIG_DFL)
        prctl(set_parent_death_signal, signal.SIGINT, 0, 0, 0)
        if os.getppid() != parent:
            os._exit(1)

    return ask


def become_another_program(parent: int) -> Callable[[], None]:
    """Return what a node's child does before it becomes another program: hear signals, and end with its parent.

    What is blocked in a node's threads is blocked in what they start, which could then be asked to end in vain.
    """
    ask = interrupt_at_death_of(parent)

    def prepare() -> None:
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        ask()

    return prepare


def adopt_orphans() -> None:
    """Become the parent of descendants whose own parent ends, so that they stay in sight (Linux: prctl(2))."""
    import ctypes

    set_child_subreaper = 36
    ctypes.CDLL(None, use_errno=True).prctl(set_child_subreaper, 1, 0, 0, 0)
