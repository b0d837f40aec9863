"""What a program says where a library that it needs is missing, or is another than it was built with."""

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
        SystemExit: A library that it needs cannot be imported; Python prints the text, one line, and exits with 1.
        ImportError: A module of the package itself is wrong, which wants its traceback.
    """
    try:
        return importlib.import_module(name)
    except ImportError as error:
        if (error.name or "").partition(".")[0] == "mbf_relay":
            raise
        reason = " ".join(str(error).split())
        raise SystemExit(f"{os.path.basename(sys.argv[0])} cannot start with {sys.executable}: {reason}") from error
