"""What a layer remembers, so that each browser gets what it has not seen and nothing twice.

Every layer counts its changes. A browser names the count it has seen and gets what came after, encoded once for however
many browsers ask.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from typing import Any, Callable, Deque, Dict, List, Optional, Tuple

from mbf_relay.view.batch import part

Taken = Tuple[Optional[bytes], int]
"""A part, None where there is nothing new, and the count up to which it tells."""


class ViewLayer(ABC):
    """One thing that is shown. Used from one thread.

    Attributes:
        revision: Counts changes; 0 means nothing to show yet.
        period: Shortest time (s) between two parts to the same browser.
    """

    def __init__(self, name: str, period: float) -> None:
        self.name, self.period = name, period
        self.revision = 0

    @abstractmethod
    def take(self, seen: int) -> Taken:
        """Return what came after `seen`, as much as one part should hold, and the count it leads to."""


class Newest(ViewLayer):
    """A layer of which only the newest counts, such as a scan."""

    def __init__(self, name: str, period: float) -> None:
        super().__init__(name, period)
        self._make: Optional[Callable[[], Optional[bytes]]] = None
        self._part: Optional[bytes] = None

    def put(self, make: Callable[[], Optional[bytes]]) -> None:
        """Replace what is shown; `make` gives the part and is called only if a browser takes it."""
        self._make = make
        self.revision += 1

    def show(self, header: Dict[str, Any], payload: bytes = b"") -> None:
        """Replace what is shown, unless it is the same."""
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
    """Entries of which a browser gets each one once, and the last `length` when it joins.

    A flood pushes out the oldest.
    """

    def __init__(self, name: str, period: float, length: int) -> None:
        super().__init__(name, period)
        self._entries: Deque[Any] = deque(maxlen=length)

    def add(self, entry: Any) -> None:
        """Append an entry, something JSON can hold."""
        self.revision += 1
        self._entries.append(entry)

    def take(self, seen: int) -> Taken:
        """Return the entries after `seen` that are still kept."""
        fresh: List[Any] = list(self._entries)[-(self.revision - seen):] if seen < self.revision else []
        return (part({"layer": self.name, "entries": fresh}) if fresh else None), self.revision
