"""The PyBullet module, loaded without the line it prints each time."""

from __future__ import annotations

import ctypes
import importlib
import os
import sys
from typing import Any


def _load_quietly() -> Any:
    """Import pybullet while the process's standard error leads nowhere; the line is written below Python."""
    sys.stderr.flush()
    c_library = ctypes.CDLL(None)
    nowhere, kept = os.open(os.devnull, os.O_WRONLY), os.dup(2)
    try:
        os.dup2(nowhere, 2)
        return importlib.import_module("pybullet")
    finally:
        c_library.fflush(None)
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


pybullet = _load_quietly()
