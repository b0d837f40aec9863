"""Memory of processes that drive many episodes: free memory is reused, and returned to the system where it is much."""

from __future__ import annotations

import functools
import gc
import sys

import psutil

from mbf_relay import memory

MOST_KEPT = 140.0
"""Size of a process (MiB, RSS) above which free memory is returned after a drive: a fifth more than one drive needs."""


def spare_what_stays() -> None:
    """Exclude all objects that exist before a drive, mostly modules, from garbage collection (gc.freeze).

    Also makes malloc keep free memory for the next drive: fresh pages from the system cost a twentieth of a drive.
    """
    _spare(len(sys.modules))


@functools.lru_cache(maxsize=None)
def _spare(_modules: int) -> None:
    """Do so once for each number of modules loaded: matplotlib or Optuna, loaded later, have half a million objects."""
    memory.keep_free()
    gc.collect()
    gc.freeze()


def give_back() -> None:
    """Collect a drive's objects, and return free memory to the system where the process is large.

    A drive's objects form reference cycles, so that only the collector frees them; it counts objects and not the
    megabytes of costmaps and worlds. What it frees lies fragmented between live objects, so that a process which drives
    many worlds would grow to several times what one drive needs.
    """
    gc.collect()
    if psutil.Process().memory_info().rss > MOST_KEPT * 2**20:
        memory.give_back_free()
