"""Layers of the view, which give each browser what is new to it.

Every layer counts its changes (revision). A browser's Feed keeps the revision that it has seen, and `take` returns what
came after, encoded once for all browsers.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from typing import Any, Callable, Deque, Dict, List, Optional, Tuple

from mbf_relay.view.batch import part

Taken = Tuple[Optional[bytes], int]
"""A part, None where there is nothing new, and the revision that it leads to."""


class ViewLayer(ABC):
    """A layer of the view. Used from one thread.

    Attributes:
        name: Its name in the protocol.
        revision: Number of changes so far; 0 where there is nothing to show.
        period: Shortest time (s) between two parts to one browser.
    """

    def __init__(self, name: str, period: float) -> None:
        self.name, self.period = name, period
        self.revision = 0

    @abstractmethod
    def take(self, seen: int) -> Taken:
        """Return the changes after revision `seen`, up to the size of one part, and the revision they lead to."""


class Newest(ViewLayer):
    """A layer that shows only the newest state, such as a scan."""

    def __init__(self, name: str, period: float) -> None:
        super().__init__(name, period)
        self._make: Optional[Callable[[], Optional[bytes]]] = None
        self._part: Optional[bytes] = None

    def put(self, make: Callable[[], Optional[bytes]]) -> None:
        """Replace the state; `make` encodes it, and is called only if a browser takes it."""
        self._make = make
        self.revision += 1

    def show(self, header: Dict[str, Any], payload: bytes = b"") -> None:
        """Replace the state, unless it is equal."""
        encoded = part({"layer": self.name, **header}, payload)
        if self._make is not None or encoded != self._part:
            self._make, self._part = None, encoded
            self.revision += 1

    def take(self, seen: int) -> Taken:
        """Return the newest, if `seen` is older."""
        if seen == self.revision:
            return None, seen
        if self._make is not None:
            self._part, self._make = self._make(), None
        return self._part, self.revision


class Journal(ViewLayer):
    """A list of entries, such as log lines: a browser gets each one once, and the last `length` when it connects."""

    def __init__(self, name: str, period: float, length: int) -> None:
        super().__init__(name, period)
        self._entries: Deque[Any] = deque(maxlen=length)

    def add(self, entry: Any) -> None:
        """Append an entry that can be encoded as JSON."""
        self.revision += 1
        self._entries.append(entry)

    def take(self, seen: int) -> Taken:
        """Return the entries after `seen` that are still kept."""
        fresh: List[Any] = list(self._entries)[-(self.revision - seen):] if seen < self.revision else []
        return (part({"layer": self.name, "entries": fresh}) if fresh else None), self.revision
