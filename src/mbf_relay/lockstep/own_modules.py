"""What a user's own code consists of: a module, and all it imports that is his as well."""

from __future__ import annotations

import ast
import importlib.util
import sysconfig
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Dict, Iterator, List, Optional

PACKAGE = __name__.split(".")[0]
INSTALLED = {"site-packages", "dist-packages"}
"""Folders of what others wrote, such as NumPy, whose versions are not told here."""
STANDARD = Path(sysconfig.get_paths()["stdlib"]).resolve()


def own_modules(name: str) -> Dict[str, bytes]:
    """Return the contents of a module and of all it imports, at once or later, by their names.

    Left out are Python's own modules, this package's, and installed ones but for those of the module's own package:
    so the same code has the same contents wherever it lies.

    Args:
        name: Of the module, with its package's.

    Raises:
        OSError: One cannot be read.
        SyntaxError: It is no Python.
    """
    found: Dict[str, bytes] = {}
    own = name.split(".")[0]
    seen, waiting = set(), [name]
    while waiting:
        name = waiting.pop()
        parent = name.rpartition(".")[0]
        if name in seen or not _is_own(name.split(".")[0], own):
            continue
        seen.add(name)
        waiting += [parent] if parent else []
        spec = _spec(name)
        if spec is None or spec.origin is None or not Path(spec.origin).is_file():
            continue
        found[name] = Path(spec.origin).read_bytes()
        if spec.origin.endswith(".py"):
            package = name if spec.submodule_search_locations is not None else parent
            waiting += _imports(package, found[name])
    return found


def _is_own(top: str, own: str) -> bool:
    """Return whether a package or module at the top level is the user's; `own` is without a look."""
    if top in (own, PACKAGE):
        return top == own
    spec = _spec(top)
    places: List[str] = [] if spec is None else [*(spec.submodule_search_locations or []), spec.origin or ""]
    place = Path(next(filter(None, places), "built-in")).resolve()
    return place.exists() and STANDARD not in place.parents and not INSTALLED & set(place.parts)


def _spec(name: str) -> Optional[ModuleSpec]:
    """Return where a module lies; None where there is none. Its package is imported for that."""
    try:
        return importlib.util.find_spec(name)
    except Exception:  # whatever a user's package does when it is run, or a name that is no module
        return None


def _imports(package: str, content: bytes) -> Iterator[str]:
    """Yield the names of what a module of a package may import: modules, and what may be one."""
    for node in ast.walk(ast.parse(content)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and (package or not node.level):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)
