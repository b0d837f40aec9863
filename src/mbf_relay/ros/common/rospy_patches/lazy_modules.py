"""Modules that libraries import and no node uses: read where somebody does, and until then neither time nor memory."""

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
"""7 MiB of a node's 32, and a tenth of the time its imports take. roslib.stacks brings catkin's package parser, ssl the
encryption that ROS has none of; rospy and the servers of the standard library import them, NumPy its own.
"""

KNOWN_BEFORE = frozenset(("__file__", "__name__", "__package__", "__spec__"))
"""What importing a module once more asks of it, and who looks for the module of a file asks of each."""


class LazyModule(ModuleType):
    """A module that is executed at the first look at it, by whoever looks; others wait until it is whole.

    importlib's own lets other threads look into it half made (Python's issue 114763, mended in 3.12).
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
    """Loads a module without executing it, and keeps what that takes.

    Args:
        loader: Executes it.

    Attributes:
        lock: Held while it is executed.
        is_under_way: It is, and looks at itself.
    """

    def __init__(self, loader: Any) -> None:
        self.loader = loader
        self.lock = threading.RLock()
        self.is_under_way = False

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> Optional[ModuleType]:
        """Return the module, not executed; None for a plain one."""
        created: Optional[ModuleType] = self.loader.create_module(spec)
        return created

    def exec_module(self, module: ModuleType) -> None:
        """Leave the module to be executed by the first who looks at it."""
        spec = module.__spec__
        assert spec is not None
        module.__loader__ = spec.loader = self.loader
        spec.loader_state = self
        module.__class__ = LazyModule


class LazyFinder:
    """Finds some modules as others would, to be executed when an attribute is first asked for.

    Args:
        names: Of the modules.
    """

    def __init__(self, names: Sequence[str]) -> None:
        self._names = frozenset(names)

    def find_spec(
        self, name: str, path: Optional[Sequence[str]] = None, target: Optional[ModuleType] = None
    ) -> Optional[importlib.machinery.ModuleSpec]:
        """Return how to load a module, None where that is left to others; called by Python's import.

        Args:
            name: Its full name.
            path: Folders of the package it belongs to.
            target: As importlib has it.
        """
        if name not in self._names:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and spec.loader is not None:
            spec.loader = LazyExecution(spec.loader)
        return spec


def spare_what_nobody_uses() -> None:
    """Have UNUSED modules executed and messages read when they are used; before they are imported, in the main thread.
    """
    if not any(isinstance(finder, LazyFinder) for finder in sys.meta_path):
        sys.meta_path[:0] = [LazyFinder(UNUSED), MessageFinder()]
        _spare_pydoc()


def _spare_pydoc() -> None:
    """Import xmlrpc.server, which derives one class from pydoc's: it documents servers in HTML, and is left without."""
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
