"""Free memory, given back to the system where the C library is glibc; elsewhere nothing is done, and nothing said."""

from __future__ import annotations

ARENAS_AT_MOST = 1
"""Places that threads take memory from. glibc makes eight for each core: each fills up for itself with pieces too small
to give back, and a node has a thread for each connection. Python runs one thread at a time, so one place serves all."""
_M_ARENA_MAX, _M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -8, -1, -3  # malloc.h
_SMALL = 128 << 10
"""Bytes of a piece from which on it comes from the system by itself, and goes back as soon as it is free. glibc begins
with this limit and raises it with each larger piece that it hands back, up to 32 MiB: a server's maps then lay among
small pieces that stay, and what it held grew by a MiB every few hundred goals."""
_LARGEST_KEPT = 32 << 20
"""Bytes of one piece up to which glibc can be told to keep it."""
_MOST_KEPT = 1 << 30


def hold_little() -> None:
    """Have this process hold little more than it uses, however long it lives; before there are many threads."""
    _call("mallopt", _M_ARENA_MAX, ARENAS_AT_MOST)
    _call("mallopt", _M_MMAP_THRESHOLD, _SMALL)


def keep_free() -> None:
    """Keep what is freed for what is made next, until `give_back_free`.

    glibc hands large pieces back to the system one by one, which clears each page before it is used again.
    """
    _call("mallopt", _M_MMAP_THRESHOLD, _LARGEST_KEPT)
    _call("mallopt", _M_TRIM_THRESHOLD, _MOST_KEPT)


def give_back_free() -> None:
    """Hand what is free back to the system: a millisecond at most, in which other threads may wait for memory."""
    _call("malloc_trim", 0)


def _call(name: str, *numbers: int) -> None:
    import ctypes  # which NumPy has imported by the time that this is of use

    function = getattr(ctypes.CDLL(None), name, None)  # another C library may have none, or one that does nothing
    if function is not None:
        function(*numbers)
