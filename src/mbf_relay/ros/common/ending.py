"""Handling of the signals that end a node, in a thread of its own (sigwait).

A signal handler interrupts whatever the main thread does. In an import it causes a traceback. In a registration with
the master it deadlocks: the thread holds locks that rospy's shutdown, called in the handler, waits for. So the signals
are blocked in every thread, and one thread waits for them and shuts the node down while the others finish their work.
If the shutdown takes longer than PATIENCE, as where the master hangs, the process exits without it. This module imports
nothing of ROS, so that a node can be ended while it still imports.
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
"""Wall seconds for a node's shutdown: what it still publishes, and unregistering from the master."""


def open_standard_streams() -> None:
    """Open /dev/null in place of each of stdin, stdout and stderr that is closed; before any other file is opened.

    For a closed one Python has None, so that each log line raises an error. Also, the next file or socket would get its
    file descriptor, and what is printed would be written there.
    """
    for number, (name, mode) in enumerate((("stdin", "r"), ("stdout", "w"), ("stderr", "w"))):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_RDWR)
            if nowhere != number:
                os.dup2(nowhere, number)
                os.close(nowhere)
            setattr(sys, name, os.fdopen(number, mode, closefd=False))


def ending_signals() -> Set[signal.Signals]:
    """Return the signals that end this process: SIGINT, SIGTERM and, unless it was started with nohup, SIGHUP.

    SIGINT also where it is ignored, as in what a script starts with `&`: roslaunch ends its nodes with it.
    """
    numbers = {signal.SIGINT, signal.SIGTERM}
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
        numbers.add(signal.SIGHUP)
    return numbers


class NodeEnding:
    """Ends this process on a signal, or by `leave`; to be created before anything else, in the main thread.

    Args:
        interrupted: Exit status where a signal ends it.

    Attributes:
        begun: Whether a signal has been received.
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
        hold_little()  # limits malloc's arenas, hence before the first thread; signals are blocked while it imports
        waiting = threading.Thread(target=self._wait, name="ending", daemon=True)
        waiting.start()
        for number in numbers:  # a thread that a library started before does not block them: it passes them on
            signal.signal(number, lambda number, _frame: signal.pthread_kill(waiting.ident or 0, number))

    def use(self, shut_down: Callable[[str], None]) -> None:
        """Call `shut_down` with a reason when a signal comes; before this call a signal ends the process at once."""
        with self._lock:
            self._shut_down = shut_down

    def leave(self, status: int) -> None:
        """End the process with an exit status, after a shutdown that a signal has begun, and Python's atexit functions.

        The rest of Python's finalization is skipped: threads of C++ libraries, which still run, sometimes crash in it.
        """
        if self.begun:
            self._done.wait(PATIENCE)
        threading.Thread(target=self._end_anyway, args=(status,), name="late leave", daemon=True).start()
        atexit._run_exitfuncs()  # they remove folders in /tmp, such as rosbag makes for each bag it reads
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
    """Return a function for a child process to call first: the kernel then sends it SIGINT when its parent dies.

    Linux: prctl(2), PR_SET_PDEATHSIG. An ignored SIGINT, inherited from a script's `&`, is no longer ignored. Where the
    parent, given by its process id, is dead already, the child exits with status 1.
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
    """Return a function for a node's child to call before exec (preexec_fn): unblock signals, end with its parent.

    A child inherits the node's blocked signals, and could not be ended by them.
    """
    ask = interrupt_at_death_of(parent)

    def prepare() -> None:
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
        ask()

    return prepare


def adopt_orphans() -> bool:
    """Become the parent of descendants whose own parent ends (Linux: prctl(2), PR_SET_CHILD_SUBREAPER).

    Return whether the system allows it; qemu's emulation of another processor does not.
    """
    import ctypes

    set_child_subreaper = 36
    return bool(ctypes.CDLL(None, use_errno=True).prctl(set_child_subreaper, 1, 0, 0, 0) == 0)
