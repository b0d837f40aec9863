"""Packages of messages of which each message is read when it is asked for.

A node uses a fifth of the messages that the packages it imports from have. To import one imports all of its package,
and with each field the package of that: a hundred modules, 3 MiB of a node's 32, and a fifth of the time it starts in.
"""

from __future__ import annotations

import importlib
import importlib.machinery
import re
from types import ModuleType
from typing import Any, Iterator, List, Optional, Sequence

KINDS = ("msg", "srv")
PARTS = ("Request", "Response")
"""What stands beside a service in its module, by the end of its name."""
_LINE = re.compile(r"from \._(\w+) import \*$")


class MessagePackage(importlib.machinery.SourceFileLoader):
    """Loads a package of messages with none of them; each is imported when it is first asked for, with its fields' own.

    They are looked for at once, lest the first goal wait for them.
    """

    def exec_module(self, module: ModuleType) -> None:
        """Fill the package, as it stands where it is anything else than messages and nothing but them."""
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
    """Finds packages of messages as others would, to be read message by message."""

    def find_spec(
        self, name: str, path: Optional[Sequence[str]] = None, target: Optional[ModuleType] = None
    ) -> Optional[importlib.machinery.ModuleSpec]:
        """Return how to load a module, None where that is left to others; called by Python's import.

        Args:
            name: Its full name.
            path: Folders of the package it belongs to.
            target: As importlib has it.
        """
        package, _, kind = name.rpartition(".")
        if kind not in KINDS or not package or "." in package:
            return None
        spec = importlib.machinery.PathFinder.find_spec(name, path, target)
        if spec is not None and type(spec.loader) is importlib.machinery.SourceFileLoader:
            spec.loader = MessagePackage(spec.loader.name, spec.loader.path)
        return spec


def _modules_of(text: str) -> List[str]:
    """Return the modules, without their underscore, of which a package takes all there is; none where it does more."""
    found = [_LINE.match(line) for line in text.splitlines() if line.strip()]
    return [match.group(1) for match in found if match] if all(found) else []


def _places(modules: Sequence[str], are_services: bool) -> Iterator[Any]:
    """Yield each class of a package and the module it stands in."""
    for name in modules:
        yield name, name
        if are_services:
            for part in PARTS:
                yield name + part, name
