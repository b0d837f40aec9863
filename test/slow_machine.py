"""Processes on a computer that is slower than this one, by a quota of Linux's control groups, or has more to do."""

import contextlib
import glob
import os
import subprocess
import sys
from pathlib import Path
from typing import Dict, Iterable

ROOT = Path("/sys/fs/cgroup")
PERIOD = 10000
"""Microseconds in which a share of processor time is given and used up: well below a control period."""


class SlowMachine:
    """A control group with a share of one core; a context manager that leaves nothing behind.

    Args:
        share: Of one core, 0 to 1, for all its processes together.

    Raises:
        OSError: No such group can be made here; that takes root and a system that lets its groups be changed.
    """

    def __init__(self, share: float) -> None:
        quota = int(share * PERIOD)
        one_tree = (ROOT / "cgroup.controllers").exists()  # version 2
        self._top = ROOT if one_tree else ROOT / "cpu"
        self._folder = self._top / f"mbf_relay-{os.getpid()}"
        limits = {"cpu.max": f"{quota} {PERIOD}"} if one_tree else {
            "cpu.cfs_period_us": str(PERIOD), "cpu.cfs_quota_us": str(quota)}
        self._folder.mkdir()
        try:
            for name, value in limits.items():
                (self._folder / name).write_text(value, encoding="ascii")
        except OSError:
            self._folder.rmdir()
            raise

    def __enter__(self) -> "SlowMachine":
        return self

    def __exit__(self, *_: object) -> None:
        for line in (self._folder / "cgroup.procs").read_text(encoding="ascii").split():
            try:
                (self._top / "cgroup.procs").write_text(line, encoding="ascii")
            except ProcessLookupError:
                pass  # it has ended meanwhile
        self._folder.rmdir()

    def take(self, processes: Iterable[int]) -> None:
        """Move processes to it, and to one core: of two, one would be given all of a period's time, in turn or not."""
        core = {min(os.sched_getaffinity(0))}
        for process in processes:
            (self._folder / "cgroup.procs").write_text(str(process), encoding="ascii")
            for thread in os.listdir(f"/proc/{process}/task"):
                with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
                    os.sched_setaffinity(int(thread), core)


class BusyMachine:
    """So many processes that only compute, for as long as this context manager is entered."""

    def __init__(self, processes: int) -> None:
        self._count = processes

    def __enter__(self) -> "BusyMachine":
        self._processes = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(self._count)]
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.kill()
            process.wait()


def waits_for_a_core(pid: int) -> Dict[str, float]:
    """Return for how long (s) each thread of a process has been ready to run and had no core, by the kernel's count."""
    waits = {}
    for path in glob.glob(f"/proc/{pid}/task/*/schedstat"):
        try:
            waits[path] = int(Path(path).read_text(encoding="ascii").split()[1]) / 1e9
        except OSError:
            pass  # the thread has ended meanwhile
    return waits
