"""Computing time of an episode by stage: simulation, localization, costmaps, navigation and its plugins."""

from __future__ import annotations

from typing import Any, Callable, Dict, List, Optional

from mbf_relay.navigation.worker import InlineWorker, Job

PLUGINS = {"planners": "planning", "controllers": "control", "recovery_behaviors": "recovery"}
"""The stage of each kind of plugin."""


class Stages:
    """Sums up seconds per stage; the time of an inner stage is not part of the outer one.

    Attributes:
        seconds: Wall seconds by stage.
    """

    def __init__(self, clock: Optional[Callable[[], float]]) -> None:
        """Begin with no stages.

        Args:
            clock: Gives the time (s); where None, nothing is measured.
        """
        self._clock = clock
        self._open: List[str] = []
        self._since = 0.0
        self.seconds: Dict[str, float] = {}

    def stage(self, name: str) -> _Stage:
        """Return a context manager whose block is counted as the stage `name`."""
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


class TimedWorker(InlineWorker):
    """Runs plugins inline and counts the time of each call for its stage."""

    def __init__(self, stages: Stages) -> None:
        self._stages = stages

    def start(self, task: Callable[[], Any], kind: str = "") -> Job:
        """Run `task` to its end."""
        with self._stages.stage(PLUGINS[kind]):
            return super().start(task, kind)
