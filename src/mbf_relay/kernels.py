"""Compiled loops: one decorator for every numba kernel of the package, and the command that compiles them ahead.

Kernels live in modules named `*_kernels.py` and state their signature, so they are compiled when their module is
imported and never at a first goal. `python -m mbf_relay.kernels` imports them all, which fills numba's cache on disk;
after that an import only loads. Every kernel that another one calls stays in the same file, because numba's cache
notices changes of the file alone.
"""

from __future__ import annotations

import importlib
import pkgutil
from typing import Any, Callable, List, Union

import numba


def kernel(signature: Union[str, List[str]], **options: Any) -> Callable:
    """Compile a function for `signature` without the interpreter lock, cached on disk where a folder can be written.

    Args:
        signature: numba signature(s), e.g. "void(float32[:,::1], int64)"; arrays are C-contiguous and writable.
        options: Further options of numba.njit, e.g. fastmath=True.

    Returns:
        A decorator.
    """

    def compile_kernel(function: Callable) -> Callable:
        try:
            return numba.njit(signature, nogil=True, cache=True, **options)(function)
        except RuntimeError as error:
            if "cannot cache" not in str(error):
                raise
            return numba.njit(signature, nogil=True, **options)(function)

    return compile_kernel


def compile_all() -> List[str]:
    """Import every kernel module of the package and return their names."""
    import mbf_relay

    names = [
        module.name
        for module in pkgutil.walk_packages(mbf_relay.__path__, "mbf_relay.")
        if module.name.endswith("_kernels")
    ]
    for name in names:
        importlib.import_module(name)
    return names


if __name__ == "__main__":
    print(f"compiled {len(compile_all())} kernel modules")
