"""Settings of glibc's allocator, so that free memory returns to the system; with other C libraries nothing is done."""

from __future__ import annotations

ARENAS_AT_MOST = 1
"""Number of malloc arenas. glibc makes up to eight for each core, each with small free pieces that cannot be returned,
and a node has a thread for each connection. Python runs one thread at a time, so one arena is enough."""
_M_ARENA_MAX, _M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -8, -1, -3  # malloc.h
_SMALL = 128 << 10
"""Size (bytes) from which on a block is mapped on its own (M_MMAP_THRESHOLD) and returned to the system when freed. It
is glibc's default, which however rises with each larger block freed, up to 32 MiB: a server's maps were then placed
among small blocks that stay, and its memory grew by a MiB every few hundred goals."""
_LARGEST_KEPT = 32 << 20
"""Largest M_MMAP_THRESHOLD (bytes) that glibc accepts."""
_MOST_KEPT = 1 << 30
"""Free memory (bytes) that is kept at the top of the heap by `keep_free`."""


def hold_little() -> None:
    """Set one arena and a fixed mmap threshold; call it before threads are started."""
    _call("mallopt", _M_ARENA_MAX, ARENAS_AT_MOST)
    _call("mallopt", _M_MMAP_THRESHOLD, _SMALL)


def keep_free() -> None:
    """Keep freed blocks for later allocations, until `give_back_free`.

    Otherwise large blocks are returned to the system, which has to clear their pages before they are used again.
    """
    _call("mallopt", _M_MMAP_THRESHOLD, _LARGEST_KEPT)
    _call("mallopt", _M_TRIM_THRESHOLD, _MOST_KEPT)


def give_back_free() -> None:
    """Return free memory to the system; takes up to a millisecond, in which allocations of other threads may wait."""
    _call("malloc_trim", 0)


def _call(name: str, *numbers: int) -> None:
    import ctypes  # which NumPy has imported by the time that this is of use

    function = getattr(ctypes.CDLL(None), name, None)  # another C library may have none, or one that does nothing
    if function is not None:
        function(*numbers)
