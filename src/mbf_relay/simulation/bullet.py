"""The PyBullet module, imported without the line that it prints."""

from __future__ import annotations

import ctypes
import importlib
import os
import sys
from typing import Any

import numpy as np


def _load_quietly() -> Any:
    """Import pybullet with file descriptor 2 redirected to /dev/null, as its line is printed by C code.

    Raises:
        ImportError: It is not installed, or was compiled for a newer NumPy; the text says so, while NumPy prints that
            to stderr alone.
    """
    sys.stderr.flush()
    c_library = ctypes.CDLL(None)
    nowhere, kept = os.open(os.devnull, os.O_WRONLY), os.dup(2)
    try:
        os.dup2(nowhere, 2)
        return importlib.import_module("pybullet")
    except ImportError as error:
        if "numpy" not in str(error):
            raise
        raise ImportError(
            f"this PyBullet is made for a newer NumPy than {np.__version__}; for Ubuntu 20.04's: "
            "python3 -m pip install pybullet==3.2.5"
        ) from error
    finally:
        c_library.fflush(None)
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


pybullet = _load_quietly()
