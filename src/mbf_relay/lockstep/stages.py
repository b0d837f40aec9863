"""Where an episode's computing time goes."""

from __future__ import annotations

from typing import Any, Callable, Dict, List, Optional


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

    def stage(self, name: str) -> "_Stage":
        """Return a context: what is done inside counts for `name`."""
        return _Stage(self, name)

    def enter(self, name: str) -> None:
        """Begin a stage."""
        if self._clock is not None:
            self._switch()
            self._open.append(name)

    def leave(self) -> None:
        """End the stage begun last."""
        if self._clock is not None:
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


class _Stage:
    __slots__ = ("_stages", "_name")

    def __init__(self, stages: Stages, name: str) -> None:
        self._stages, self._name = stages, name

    def __enter__(self) -> None:
        self._stages.enter(self._name)

    def __exit__(self, *_: Any) -> None:
        self._stages.leave()
