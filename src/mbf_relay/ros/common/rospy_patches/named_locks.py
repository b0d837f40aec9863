"""Locks by name that exist only while somebody holds or waits for them."""

from __future__ import annotations

import threading
import weakref
from typing import Hashable, MutableMapping


class NamedLocks:
    """One lock for each name; names that are no longer used take no memory."""

    def __init__(self) -> None:
        self._guard = threading.Lock()  # guards the table
        self._locks: MutableMapping[Hashable, threading.Lock] = weakref.WeakValueDictionary()

    def __len__(self) -> int:
        """Return the number of locks that are referenced."""
        return len(self._locks)

    def of(self, name: Hashable) -> threading.Lock:
        """Return the lock of a name, the same for all who hold a reference to it at the same time."""
        with self._guard:
            return self._locks.setdefault(name, threading.Lock())
