"""What numba compiles of one module, as an object file with nothing else of numba's in it."""

from __future__ import annotations

import importlib
import platform
from typing import Any, Dict, List, NamedTuple

from mbf_relay import kernels

CPU = {"x86_64": "x86-64"}
"""LLVM's name of the least a processor of a kind can do, where "generic" is something else."""
WIDE = {"x86_64": "+avx2"}
"""What nearly all of a kind can do besides, which nearly halves the time of plain loops over cells; the module asks for
it when it is loaded. It changes no bit: nothing is computed in another order."""
WIDENED = (
    "mbf_relay.control.path_kernels", "mbf_relay.costmap.footprint_checker_kernels",
    "mbf_relay.costmap.inflation_kernels", "mbf_relay.costmap.layer_kernels", "mbf_relay.distance_kernels",
    "mbf_relay.localization.laser_kernels",
)
"""Modules that gain by it; each takes its time twice when the package is built."""


class KernelEntry(NamedTuple):
    """One compiled function.

    Attributes:
        name: In its module.
        symbol: In the object file.
        arguments: Names of the arguments and their numba types: "float64", "array(float64, 2d, C)".
        result: numba type of the result.
        text: The docstring.
    """

    name: str
    symbol: str
    arguments: List[List[str]]
    result: str
    text: str


def plain_processor() -> str:
    """Return the processor that code is made for, so that it runs on every one of this kind."""
    return CPU.get(platform.machine(), "generic")


def features_of(module_name: str) -> List[str]:
    """Return what a module is made for: nothing besides the plain processor, then maybe once more what others can."""
    wide = WIDE.get(platform.machine())
    return [""] if wide is None or module_name not in WIDENED else ["", wide]


def compile_module(module_name: str, object_path: str, features: str) -> List[KernelEntry]:
    """Compile the kernels of a module into an object file.

    numba must have been told for which processor by `environment`, before it was imported.

    Args:
        module_name: "mbf_relay.costmap.layer_kernels".
        object_path: Of the file to write.
        features: One of `features_of`.

    Returns:
        What is in it, in the module's order; symbols of one that is not for any processor end in "_wide".

    Raises:
        ValueError: The module has no kernels, or one with several signatures.
        OSError: The file cannot be written.
    """
    import llvmlite.binding as llvm

    module = importlib.import_module(module_name)
    entries, library = [], None
    for name, dispatcher in vars(module).items():
        # told by what it has, for numba's class of them stands elsewhere from version to version
        if not hasattr(dispatcher, "overloads") or dispatcher.__module__ != module_name:
            continue
        (compiled,) = dispatcher.overloads.values()
        entry = _entry(name, dispatcher, compiled)
        one = llvm.parse_assembly(compiled.library.get_llvm_str())
        _keep(one, [entry.symbol])
        symbol = entry.symbol + ("_wide" if features else "")  # both are linked into one module
        one.get_function(entry.symbol).name = symbol
        entries.append(entry._replace(symbol=symbol))
        if library is None:
            library = one
        else:
            library.link_in(one)
    if library is None:
        raise ValueError(f"{module_name} has no kernels")
    with open(object_path, "wb") as stream:
        stream.write(_target_machine(llvm, features).emit_object(library))
    return entries


def _entry(name: str, dispatcher: Any, compiled: Any) -> KernelEntry:
    description = compiled.fndesc
    names = dispatcher.py_func.__code__.co_varnames
    arguments = [[names[i], str(kind)] for i, kind in enumerate(description.argtypes)]
    return KernelEntry(
        name, description.llvm_func_name, arguments, str(description.restype), dispatcher.py_func.__doc__ or ""
    )


def _keep(library: Any, symbols: List[str]) -> None:
    """Drop all of a library that nobody outside calls and `symbols` do not need; hide what is left."""
    import llvmlite.binding as llvm

    for values in (library.functions, library.global_variables):
        for value in values:
            if not value.is_declaration and value.name not in symbols:
                value.linkage = "internal"
    passes = llvm.create_module_pass_manager()
    passes.add_global_dce_pass()
    passes.run(library)
    for function in library.functions:
        if not function.name.startswith("llvm."):
            function.visibility = "hidden" if function.name in symbols else "default"


def _target_machine(llvm: Any, features: str) -> Any:
    llvm.initialize()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.Target.from_default_triple().create_target_machine(
        cpu=plain_processor(), features=features, opt=3, reloc="pic", codemodel="default"
    )


def environment(features: str) -> Dict[str, str]:
    """Return what numba's environment must hold when kernels are compiled ahead for one of `features_of`."""
    return {"NUMBA_CPU_NAME": plain_processor(), "NUMBA_CPU_FEATURES": features, kernels.SWITCH: kernels.TO_BUILD}
