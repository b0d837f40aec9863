"""Memory that is given back between drives."""

from __future__ import annotations

import functools
import gc

from mbf_relay import memory


@functools.lru_cache(maxsize=None)
def spare_what_stays() -> None:
    """Have the collector look no more at what a process has before its first drive: modules, for the most part."""
    gc.collect()
    gc.freeze()


def give_back() -> None:
    """Free what a drive has left, and hand free memory to the system.

    A drive's parts know each other in circles, so that only the collector frees them, and it counts objects, not the
    megabytes of costmaps and worlds that hang on them. What is freed then lies between what lives on: a process that
    drives one world after the other would hold several times what one drive takes.
    """
    gc.collect()
    memory.give_back_free()
