"""Where an episode's computing time goes."""

from __future__ import annotations

from contextlib import contextmanager
from typing import Any, Callable, Dict, Iterator, List, Optional


class Stages:
    """Sums up seconds per stage; a stage within a stage counts for the inner one alone."""

    def __init__(self, clock: Optional[Callable[[], float]]) -> None:
        """Make a sum of nothing.

        Args:
            clock: Tells the time (s); without one, nothing is measured.
        """
        self._clock = clock
        self._open: List[str] = []
        self._since = 0.0
        self.seconds: Dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count what is done inside for `name`."""
        if self._clock is None:
            yield
            return
        self._switch()
        self._open.append(name)
        try:
            yield
        finally:
            self._switch()
            self._open.pop()

    def timed(self, name: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return `call` with its time counted for `name`."""
        if self._clock is None:
            return call

        def counted(*arguments: Any, **keywords: Any) -> Any:
            with self.stage(name):
                return call(*arguments, **keywords)

        return counted

    def _switch(self) -> None:
        assert self._clock is not None
        now = self._clock()
        if self._open:
            self.seconds[self._open[-1]] = self.seconds.get(self._open[-1], 0.0) + now - self._since
        self._since = now
