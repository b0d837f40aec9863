"""Lazy import of messages: of a message package only those that are used.

Importing one message imports all messages of its package, and all packages of their fields. A node uses a fifth of
them; the others are a hundred modules, 3 MiB of a node's 32, and a fifth of its start-up time.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import re
from types import ModuleType
from typing import Any, Iterator, List, Optional, Sequence

KINDS = ("msg", "srv")
"""Subpackages with messages and services."""
PARTS = ("Request", "Response")
"""Suffixes of the further classes in a service's module."""
_LINE = re.compile(r"from \._(\w+) import \*$")  # the lines of a generated package's __init__.py


class MessagePackage(importlib.machinery.SourceFileLoader):
    """Loads a message package without its messages; each is imported at the first access (PEP 562).

    With a message, those of its fields are imported at once, so that the first goal does not wait for them.
    """

    def exec_module(self, module: ModuleType) -> None:
        """Set up the package; execute it as usual where its __init__.py has more than imports of messages."""
        modules = _modules_of(self.get_data(self.path).decode("utf-8", "replace"))
        if not modules:
            super().exec_module(module)
            return
        places = dict(_places(modules, module.__name__.endswith(".srv")))

        def find(name: str) -> Any:
            if name not in places:
                raise AttributeError(f"module '{module.__name__}' has no attribute '{name}'")
            found = getattr(importlib.import_module(f"{module.__name__}._{places[name]}"), name)
            setattr(module, name, found)
            for field in getattr(found, "_slot_types", ()):
                package, _, kind = field.partition("[")[0].rpartition("/")
                if package:
                    getattr(importlib.import_module(f"{package}.msg"), kind)
            return found

        vars(module).update(__getattr__=find, __all__=list(places), __dir__=lambda: sorted({*vars(module), *places}))


class MessageFinder:
    """A meta path finder that loads message packages by MessagePackage."""

    def find_spec(
        self, name: str, path: Optional[Sequence[str]] = None, target: Optional[ModuleType] = None
    ) -> Optional[importlib.machinery.ModuleSpec]:
        """Return the spec of PACKAGE.msg or PACKAGE.srv, None for other modules; called by Python's import.

        Args:
            name: Full name of the module.
            path, target: As for importlib.abc.MetaPathFinder.find_spec.
        """
        package, _, kind = name.rpartition(".")
        if kind not in KINDS or not package or "." in package:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and type(spec.loader) is importlib.machinery.SourceFileLoader:
            spec.loader = MessagePackage(spec.loader.name, spec.loader.path)
        return spec


def _modules_of(text: str) -> List[str]:
    """Return the modules, without underscore, that an __init__.py imports all of; empty where it has other lines."""
    found = [_LINE.match(line) for line in text.splitlines() if line.strip()]
    return [match.group(1) for match in found if match] if all(found) else []


def _places(modules: Sequence[str], are_services: bool) -> Iterator[Any]:
    """Yield the name of each class of a package and its module."""
    for name in modules:
        yield name, name
        if are_services:
            for part in PARTS:
                yield name + part, name
