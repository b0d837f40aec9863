"""A plugin of pytest (`-p shadow_kernels`): every kernel that was built runs beside numba's own, on the same arguments.

Whatever tests give it is compared to the last bit: the result, and what it left in its arrays. Needs the built package.
"""

import importlib.util
import sys
from collections import Counter

import numpy as np
import pytest

CALLS = Counter()
COMPARED = 200  # of each kernel; later calls go to the built one alone


def pytest_configure(config):
    from mbf_relay import _kernels

    for module, kernels in _kernels.KERNELS.items():
        reference = None
        for name, built in list(kernels.items()):
            reference = reference or Reference(module)
            kernels[name] = shadow(f"{module}.{name}", built, reference, name)


def pytest_terminal_summary(terminalreporter):
    from mbf_relay import _kernels

    every = {f"{module}.{name}" for module, kernels in _kernels.KERNELS.items() for name in kernels}
    terminalreporter.write_line(f"kernels compared: {len(CALLS)} of {len(every)}, {sum(CALLS.values())} calls")
    terminalreporter.write_line(f"never called from Python: {sorted(every - set(CALLS))}")


class Reference:
    """A module's kernels as numba compiles them in the process, once one is asked for."""

    def __init__(self, module):
        self._module, self._loaded = module, None

    def kernel(self, name):
        if self._loaded is None:
            path = importlib.util.find_spec(self._module).origin
            spec = importlib.util.spec_from_file_location("numba_" + self._module.replace(".", "_"), path)
            self._loaded = importlib.util.module_from_spec(spec)
            sys.modules[spec.name] = self._loaded
            spec.loader.exec_module(self._loaded)
        return getattr(self._loaded, name)


def bits(value):
    return np.asarray(value).tobytes()


def shadow(full_name, built, reference, name):
    def both(*arguments):
        CALLS[full_name] += 1
        if CALLS[full_name] > COMPARED:
            return built(*arguments)
        copies = [argument.copy() if isinstance(argument, np.ndarray) else argument for argument in arguments]
        result, expected = built(*arguments), reference.kernel(name)(*copies)
        assert result == expected or bits(result) == bits(expected), f"{full_name}: {result} is not {expected}"
        for place, (argument, copy) in enumerate(zip(arguments, copies)):
            if isinstance(argument, np.ndarray) and bits(argument) != bits(copy):
                pytest.exit(f"{full_name}: array {place} differs from numba's", 1)
        return result

    return both
