"""Lazy import of modules that libraries import and nodes hardly ever use, to save time and memory at start."""

from __future__ import annotations

import importlib
import importlib.machinery
import sys
import threading
from types import ModuleType
from typing import TYPE_CHECKING, Any, Optional, Sequence

from mbf_relay.ros.common.rospy_patches.message_modules import MessageFinder

if TYPE_CHECKING:
    from importlib.abc import Loader
else:
    Loader = object  # importlib.abc reads how resources of packages are found, a quarter of a MiB

UNUSED = (
    "calendar", "html", "ipaddress", "locale", "numpy.fft", "numpy.ma", "numpy.polynomial", "pydoc", "roslib.stacks",
    "ssl", "xml.dom.minidom",
)
"""Modules that are imported lazily: 7 MiB of a node's 32, and a tenth of its import time.

roslib.stacks imports catkin's package parser; ssl is imported by servers of the standard library that rospy uses.
"""

KNOWN_BEFORE = frozenset(("__file__", "__name__", "__package__", "__spec__"))
"""Attributes that do not cause execution: they are read by repeated imports, and by code that goes through sys.modules.
"""


class LazyModule(ModuleType):
    """A module that is executed at the first access to an attribute; other threads wait until it is complete.

    importlib.util.LazyLoader lets other threads see it half executed (CPython issue 114763, fixed in 3.12).
    """

    def __getattribute__(self, attribute: str) -> Any:
        plain = super().__getattribute__
        if attribute in KNOWN_BEFORE:
            return plain(attribute)
        execution: LazyExecution = plain("__spec__").loader_state
        with execution.lock:
            if type(self) is LazyModule and not execution.is_under_way:
                execution.is_under_way = True
                try:
                    execution.loader.exec_module(self)
                    self.__class__ = ModuleType  # type: ignore[assignment]
                finally:
                    execution.is_under_way = False
            return plain(attribute)


class LazyExecution(Loader):
    """A loader that delays a module's execution.

    Args:
        loader: The loader that executes the module.

    Attributes:
        lock: Held during execution.
        is_under_way: Whether the module is being executed, and may access its own attributes.
    """

    def __init__(self, loader: Any) -> None:
        self.loader = loader
        self.lock = threading.RLock()
        self.is_under_way = False

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> Optional[ModuleType]:
        """Return the module, not executed; None for the default."""
        created: Optional[ModuleType] = self.loader.create_module(spec)
        return created

    def exec_module(self, module: ModuleType) -> None:
        """Make the module a LazyModule instead of executing it."""
        spec = module.__spec__
        assert spec is not None
        module.__loader__ = spec.loader = self.loader
        spec.loader_state = self
        module.__class__ = LazyModule


class LazyFinder:
    """A meta path finder that makes some modules lazy.

    Args:
        names: Full names of the modules.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = frozenset(names)

    def find_spec(
        self, name: str, path: Optional[Sequence[str]] = None, target: Optional[ModuleType] = None
    ) -> Optional[importlib.machinery.ModuleSpec]:
        """Return the spec of a module in `names`, None for others; called by Python's import.

        Args:
            name: Full name of the module.
            path, target: As for importlib.abc.MetaPathFinder.find_spec.
        """
        if name not in self._names:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyExecution(spec.loader)
        return spec


def import_lazily() -> None:
    """Make UNUSED modules and the modules of messages lazy; call in the main thread, before they are imported."""
    if not any(isinstance(finder, LazyFinder) for finder in sys.meta_path):
        sys.meta_path[:0] = [LazyFinder(UNUSED), MessageFinder()]
        _leave_out_pydoc()


def _leave_out_pydoc() -> None:
    """Import xmlrpc.server without pydoc, of which it only needs a base class of its HTML documentation."""
    if "xmlrpc.server" in sys.modules or "pydoc" in sys.modules:
        return
    base = ModuleType("pydoc")
    base.HTMLDoc = object  # type: ignore[attr-defined]
    sys.modules["pydoc"] = base
    try:
        server = importlib.import_module("xmlrpc.server")
    finally:
        del sys.modules["pydoc"]
    server.pydoc = importlib.import_module("pydoc")  # type: ignore[attr-defined]
