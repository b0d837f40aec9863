"""The decorator of all compiled loops (kernels) of the package.

Kernels are plain functions in modules named `*_kernels.py`, with their numba signature. When the package is built,
`mbf_relay.kernel_build` compiles them all with numba and links the machine code into one extension module, `_kernels`.
Running nodes then need neither numba nor LLVM, which take 100 MiB of memory and a second to import. The code is built
for the baseline of the processor family, and some of it also for AVX2; results are bit-identical to numba's in the
process. Cython and Pythran would give others, and numba's own pycc is deprecated and cannot release the interpreter
lock.

A kernel that is not in there, such as one of a user's plugin, or one whose file has changed since, is compiled by numba
when its module is imported, not at the first goal. Kernels and constants that a kernel uses must be in its own file,
because neither numba's cache nor the build notices changes of other files.
"""

from __future__ import annotations

import hashlib
import importlib
import os
import pkgutil
from functools import lru_cache
from typing import Any, Callable, Dict, List, Optional, Union

SWITCH = "MBF_RELAY_KERNELS"
"""Environment variable. IN_PROCESS: numba compiles all kernels, as if none were built; TO_BUILD: the same, uncached;
PLAIN: built kernels without AVX2 are used; UNCOMPILED: kernels stay Python functions."""
IN_PROCESS, TO_BUILD, PLAIN, UNCOMPILED = "in process", "to build", "plain", "uncompiled"
_reasons: List[str] = []


def kernel(signature: Union[str, List[str]], **options: Any) -> Callable:
    """Return a decorator that compiles a function for `signature`, without the interpreter lock, or finds it built.

    Args:
        signature: numba signature(s), e.g. "void(float32[:,::1], int64)"; arrays are C-contiguous and writable.
        options: Further options of numba.njit.

    Returns:
        A decorator.
    """

    def find_or_compile(function: Callable) -> Callable:
        if os.environ.get(SWITCH) == UNCOMPILED:
            return function
        found = _built(function.__module__, function.__code__.co_filename).get(function.__name__)
        return _compile(function, signature, options) if found is None else found

    return find_or_compile


def reason_in_process() -> Optional[str]:
    """Return why kernels of the package are compiled in this process, in one sentence; None where they are not."""
    return _reasons[0] if _reasons else None


def module_names() -> List[str]:
    """Return the names of the package's kernel modules."""
    import mbf_relay

    modules = pkgutil.walk_packages(mbf_relay.__path__, "mbf_relay.")
    return sorted({module.name for module in modules if module.name.endswith("_kernels") and "._" not in module.name})


def compile_all() -> List[str]:
    """Import every kernel module of the package, which fills numba's cache on disk, and return their names."""
    names = module_names()
    for name in names:
        importlib.import_module(name)
    return names


def digest(path: str) -> str:
    """Return the SHA-256 digest of a source file; empty for a file that cannot be read."""
    try:
        with open(path, "rb") as stream:
            return hashlib.sha256(stream.read()).hexdigest()
    except OSError:
        return ""


@lru_cache(maxsize=None)
def _built(module: str, path: str) -> Dict[str, Callable]:
    """Return the built kernels of a module by name; empty if they were built from another version of the file."""
    if not module.startswith("mbf_relay."):
        return {}
    extension = _extension()
    if extension is None:
        return {}
    if extension.SOURCES.get(module) != digest(path):
        _reasons.append(f"{module} has changed since the kernels were built: build the package again")
        return {}
    found: Dict[str, Callable] = extension.KERNELS[module]
    return found


@lru_cache(maxsize=None)
def _extension() -> Any:
    if os.environ.get(SWITCH) in (IN_PROCESS, TO_BUILD):
        return None
    try:
        return importlib.import_module("mbf_relay._kernels")
    except ModuleNotFoundError:
        _reasons.append("no kernels were built for this Python and processor")
    except (ImportError, RuntimeError) as error:  # made for another NumPy
        _reasons.append(f"the kernels that were built cannot be used: {error}")
    return None


def _compile(function: Callable, signature: Union[str, List[str]], options: Dict[str, Any]) -> Callable:
    """Have numba compile a function now, cached on disk where a folder can be written.

    Raises:
        ImportError: There is no numba for the NumPy of this process; the text names that one.
    """
    try:
        import numba
    except ImportError as error:
        import numpy

        raise ImportError(
            f"numba, which is to compile kernels in this process, cannot be used with NumPy {numpy.__version__} of "
            f"{os.path.dirname(numpy.__file__)}: {error}; where that is not the system's NumPy, remove it"
        ) from error
    cache = os.environ.get(SWITCH) != TO_BUILD  # what is loaded from a cache cannot be linked
    try:
        compiled: Callable = numba.njit(signature, nogil=True, cache=cache, **options)(function)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        compiled = numba.njit(signature, nogil=True, **options)(function)
    return compiled
