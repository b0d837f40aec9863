"""Import of a program's modules, with one line for the user where a library is missing or of another version."""

from __future__ import annotations

import importlib
import os
import sys
from types import ModuleType


def import_or_exit(name: str) -> ModuleType:
    """Import a module of the package for a program that begins.

    Args:
        name: Of the module, with its packages.

    Raises:
        SystemExit: A library cannot be imported; Python prints the text, one line, and exits with status 1.
        ImportError: A module of the package itself cannot be imported, a defect whose traceback is needed.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        if (error.name or "").partition(".")[0] == "mbf_relay":
            raise
        reason = " ".join(str(error).split())
        raise SystemExit(f"{os.path.basename(sys.argv[0])} cannot start with {sys.executable}: {reason}") from error
