"""Modules that libraries import and no node uses: read where somebody does, and until then neither time nor memory."""

from __future__ import annotations

import importlib.machinery
import importlib.util
import sys
from types import ModuleType
from typing import Optional, Sequence

UNUSED = ("roslib.stacks", "ssl", "numpy.ma", "numpy.polynomial")
"""6 MiB of a node's 32, and a tenth of the time its imports take. roslib.stacks brings catkin's package parser, ssl the
encryption that ROS has none of; rospy imports both, NumPy the others.
"""


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
            spec.loader = importlib.util.LazyLoader(spec.loader)
        return spec


def spare_what_nobody_uses() -> None:
    """Have UNUSED modules executed when they are used; to be called before they are imported, in the main thread."""
    if not any(isinstance(finder, LazyFinder) for finder in sys.meta_path):
        sys.meta_path.insert(0, LazyFinder(UNUSED))
