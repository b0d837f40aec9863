"""Memory that is kept from drive to drive, and given back where it is much."""

from __future__ import annotations

import functools
import gc
import sys

import psutil

from mbf_relay import memory

MOST_KEPT = 140.0
"""MiB of a process from which on free memory is given back after a drive: a fifth more than one drive needs."""


def spare_what_stays() -> None:
    """Have the collector look no more at what a process has before a drive: modules, for the most part.

    From now on a drive takes over the memory that the one before has left: to have it from the system again, cleared
    page by page, takes a twentieth of a drive.
    """
    _spare(len(sys.modules))


@functools.lru_cache(maxsize=None)
def _spare(_modules: int) -> None:
    """Do so once for as many modules: what draws or keeps a study comes later, with half a million objects of its own.
    """
    memory.keep_free()
    gc.collect()
    gc.freeze()


def give_back() -> None:
    """Free what a drive has left, and where that is much, hand free memory to the system.

    A drive's parts know each other in circles, so that only the collector frees them, and it counts objects, not the
    megabytes of costmaps and worlds that hang on them. What is freed then lies between what lives on: a process that
    drives one world after the other would hold several times what one drive takes.
    """
    gc.collect()
    if psutil.Process().memory_info().rss > MOST_KEPT * 2**20:
        memory.give_back_free()
