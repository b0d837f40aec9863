"""The processes of a job of the tests: how they share the machine, and that none of them outlives it."""

import contextlib
import os
import signal
import subprocess
import time
from typing import Dict

import psutil

NICENESS = 19
"""Of what computes beside robots that drive: an eightieth of their share, where both want the same core."""
PATIENCE = 10.0
"""Seconds after a job's end in which what it started may end as well."""
KILLED_WITHIN = 10.0
"""Seconds in which what was killed is gone, also on a machine that has no time for it."""
_PAUSE = 0.05


def give_way(process: subprocess.Popen) -> None:
    """Let a process and what it starts have what others leave, also where each session has a share of its own."""
    with contextlib.suppress(OSError):  # it has ended, or this kernel knows no such groups
        os.setpriority(os.PRIO_PGRP, process.pid, NICENESS)
        with open(f"/proc/{process.pid}/autogroup", "w", encoding="ascii") as stream:
            stream.write(str(NICENESS))


def end_group(process: subprocess.Popen) -> None:
    """End a process and whatever it has started."""
    for number, patience in ((signal.SIGINT, 20.0), (signal.SIGKILL, 10.0)):
        if process.poll() is not None:
            break
        os.killpg(process.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(patience)


def end_what_is_left(group: int) -> str:
    """End what a job's own process has left behind in its group; say what that was, empty for nothing."""
    end = time.monotonic() + PATIENCE
    left = _members(group)
    while left and time.monotonic() < end:
        psutil.wait_procs(left, timeout=_PAUSE)
        left = _members(group)
    for process in left:
        with contextlib.suppress(psutil.Error):
            process.kill()
    psutil.wait_procs(left, timeout=KILLED_WITHIN)
    return f"it left behind: {', '.join(sorted(left.values()))}" if left else ""


def _members(group: int) -> Dict[psutil.Process, str]:
    """Return the processes of a group that have not ended, with their names."""
    found: Dict[psutil.Process, str] = {}
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return found
    for process in psutil.process_iter():
        with contextlib.suppress(ProcessLookupError, psutil.Error):
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                found[process] = process.name()
    return found
