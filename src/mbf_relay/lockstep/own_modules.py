"""The source files of a user's plugin: its module, and all modules of the user's that it imports."""

from __future__ import annotations

import ast
import importlib.util
import sysconfig
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Dict, Iterator, List, Optional

PACKAGE = __name__.split(".")[0]
"""Name of this package."""
INSTALLED = {"site-packages", "dist-packages"}
"""Folders of installed packages, such as NumPy, which are not the user's code."""
STANDARD = Path(sysconfig.get_paths()["stdlib"]).resolve()
"""Folder of Python's standard library."""


def own_modules(name: str) -> Dict[str, bytes]:
    """Return the contents of a module's file and of all it imports, also inside functions, by the modules' names.

    Left out are Python's standard library, this package, and installed packages other than the module's own. So the
    same code has the same contents on every machine.

    Args:
        name: Full name of the module.

    Raises:
        OSError: A file cannot be read.
        SyntaxError: A file is no valid Python.
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
    """Return whether a top-level package or module is the user's: `own`, or one that is neither standard nor installed.
    """
    if top in (own, PACKAGE):
        return top == own
    spec = _spec(top)
    places: List[str] = [] if spec is None else [*(spec.submodule_search_locations or []), spec.origin or ""]
    place = Path(next(filter(None, places), "built-in")).resolve()
    return place.exists() and STANDARD not in place.parents and not INSTALLED & set(place.parts)


def _spec(name: str) -> Optional[ModuleSpec]:
    """Return a module's spec, None where there is no such module; importlib imports its package for that."""
    try:
        return importlib.util.find_spec(name)
    except Exception:  # a user's package may raise anything when it is imported
        return None


def _imports(package: str, content: bytes) -> Iterator[str]:
    """Yield the full names of what a module imports; of `from a import b` both a and a.b, which may be a module."""
    for node in ast.walk(ast.parse(content)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and (package or not node.level):
            base = importlib.util.resolve_name("." * node.level + (node.module or ""), package)
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)
