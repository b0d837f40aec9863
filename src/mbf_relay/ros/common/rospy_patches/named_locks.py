"""Locks by name, of which none stays that nobody holds or waits for."""

from __future__ import annotations

import threading
import weakref
from typing import Hashable, MutableMapping


class NamedLocks:
    """One lock a name, for names that come and go for as long as a node lives, or that strangers choose."""

    def __init__(self) -> None:
        self._guard = threading.Lock()  # guards the table
        self._locks: MutableMapping[Hashable, threading.Lock] = weakref.WeakValueDictionary()

    def __len__(self) -> int:
        """Return how many are held or waited for."""
        return len(self._locks)

    def of(self, name: Hashable) -> threading.Lock:
        """Return the lock of a name, the same for all who have it at the same time."""
        with self._guard:
            return self._locks.setdefault(name, threading.Lock())
