"""Processes on a computer that is slower than this one: a quota of processor time, by Linux's control groups."""

import os
from pathlib import Path
from typing import Iterable

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
        """Move processes to it."""
        for process in processes:
            (self._folder / "cgroup.procs").write_text(str(process), encoding="ascii")
