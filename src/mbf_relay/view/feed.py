"""What one browser gets, and when: the newest of what it asked for, no sooner than it has taken what came before."""

from __future__ import annotations

from typing import Dict, List, Mapping, Optional

from mbf_relay.view.batch import batch
from mbf_relay.view.layers import ViewLayer

WINDOW = 2
"""Batches on their way at once: one is drawn while the next travels. A browser that takes none gets no more."""
BATCH_BYTES = 1 << 18
"""Bytes after which a batch takes no further layer."""


class Feed:
    """One browser's view of the layers.

    Nothing queues here: a browser that is slow to acknowledge finds, when it does, the newest of every layer.
    """

    def __init__(self) -> None:
        self._periods: Dict[str, float] = {}
        self._seen: Dict[str, int] = {}
        self._due: Dict[str, float] = {}
        self._sent = self._acknowledged = 0

    @property
    def in_flight(self) -> int:
        """Batches sent and not yet acknowledged."""
        return self._sent - self._acknowledged

    @property
    def wanted(self) -> List[str]:
        """The layers that are switched on."""
        return list(self._periods)

    def want(self, periods: Mapping[str, float]) -> None:
        """Take what is to be shown: names of layers with the shortest time (s) between two parts of each.

        A layer switched off is forgotten, so that it comes whole when it is switched on again.
        """
        self._periods = dict(periods)
        self._seen = {name: seen for name, seen in self._seen.items() if name in periods}

    def forget(self) -> None:
        """Start anew, for another robot's layers."""
        self._seen.clear()
        self._due.clear()

    def acknowledge(self, number: int) -> None:
        """Take note that the browser has shown batch `number`; one that was never sent changes nothing."""
        if self._acknowledged < number <= self._sent:
            self._acknowledged = number

    def next_batch(self, layers: Mapping[str, ViewLayer], now: float) -> Optional[bytes]:
        """Return what is due at `now` (s), None where nothing is or the browser is not ready."""
        if self.in_flight >= WINDOW:
            return None
        parts: List[bytes] = []
        size = 0
        for name, period in self._periods.items():
            layer = layers.get(name)
            seen = self._seen.get(name, 0)
            if layer is None or seen == layer.revision or now < self._due.get(name, now) or size > BATCH_BYTES:
                continue
            content, self._seen[name] = layer.take(seen)
            complete = self._seen[name] == layer.revision
            self._due[name] = now + max(period, layer.period) if complete else now
            if content is not None:
                parts.append(content)
                size += len(content)
        if not parts:
            return None
        self._sent += 1
        return batch(self._sent, parts)

    def next_due(self, layers: Mapping[str, ViewLayer], now: float) -> Optional[float]:
        """Return when (s) something that has changed is due, None where nothing has or the browser is not ready."""
        if self.in_flight >= WINDOW:
            return None
        times = [
            max(now, self._due.get(name, now)) for name in self._periods
            if name in layers and self._seen.get(name, 0) != layers[name].revision
        ]
        return min(times) if times else None
