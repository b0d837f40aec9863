"""Flow control for one browser: it gets the newest of the layers it wants once it has acknowledged earlier batches."""

from __future__ import annotations

from typing import Dict, List, Mapping, Optional

from mbf_relay.view.batch import batch
from mbf_relay.view.layers import ViewLayer

WINDOW = 2
"""Largest number of batches without acknowledgement: one is drawn while the next is on its way."""
BATCH_BYTES = 1 << 18
"""Size (bytes) from which on no further layer is added to a batch."""


class Feed:
    """The layers that one browser wants, and what it has got of each.

    Nothing is queued: a browser that acknowledges late then gets the newest state of every layer.
    """

    def __init__(self) -> None:
        self._periods: Dict[str, float] = {}
        self._seen: Dict[str, int] = {}
        self._due: Dict[str, float] = {}
        self._sent = self._acknowledged = 0

    @property
    def in_flight(self) -> int:
        """Number of batches sent and not yet acknowledged."""
        return self._sent - self._acknowledged

    @property
    def wanted(self) -> List[str]:
        """The layers that are switched on."""
        return list(self._periods)

    def want(self, periods: Mapping[str, float]) -> None:
        """Set the wanted layers, with the shortest time (s) between two parts of each.

        A layer that is no longer wanted is sent as a whole when it is wanted again.
        """
        self._periods = dict(periods)
        self._seen = {name: seen for name, seen in self._seen.items() if name in periods}

    def forget(self) -> None:
        """Start over, with another robot's layers."""
        self._seen.clear()
        self._due.clear()

    def acknowledge(self, number: int) -> None:
        """Note that the browser has drawn batch `number`; ignored where that was never sent."""
        if self._acknowledged < number <= self._sent:
            self._acknowledged = number

    def next_batch(self, layers: Mapping[str, ViewLayer], now: float) -> Optional[bytes]:
        """Return a batch of what is due at `now` (s), None where nothing is or acknowledgements are missing."""
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
        """Return the time (s) at which the next batch is due, None where nothing changed or acknowledgements miss."""
        if self.in_flight >= WINDOW:
            return None
        times = [
            max(now, self._due.get(name, now)) for name in self._periods
            if name in layers and self._seen.get(name, 0) != layers[name].revision
        ]
        return min(times) if times else None
