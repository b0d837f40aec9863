"""The C source of the extension module: a function for each kernel that takes Python objects."""

from __future__ import annotations

import json
import re
from typing import List, Mapping, Tuple

from mbf_relay.kernel_build.kernel_objects import KernelEntry

C_TYPES = {
    "float64": "double", "float32": "float", "boolean": "bool", "bool": "bool",
    **{f"{sign}int{bits}": f"{sign}int{bits}_t" for sign in ("", "u") for bits in (8, 16, 32, 64)},
}
"""numba's scalars."""
NUMPY_TYPES = {kind: "NPY_BOOL" if kind.startswith("bool") else f"NPY_{kind.upper()}" for kind in C_TYPES}
"""numba's elements of arrays."""
ARRAY = re.compile(r"array\((\w+), (\d+)d, C\)")
TUPLE = re.compile(r"UniTuple\((\w+) x (\d+)\)")


def module_source(entries: Mapping[str, List[List[KernelEntry]]], sources: Mapping[str, str]) -> str:
    """Return the C source of the module `_kernels`, to be compiled with support.c before it.

    Args:
        entries: Kernels by their module's name, each made for any processor first, some then for those that can more.
        sources: Digest of each module's source, by which a later source is told from this one.

    Raises:
        KeyError: A kernel takes or returns what is no scalar of C_TYPES, C-contiguous array or tuple of equal scalars.
    """
    functions: List[str] = []
    table: List[str] = []
    for module in sorted(entries):
        for same in entries[module]:
            name, kernel = f"wrapper_{len(table)}", same[0]
            functions.append(_wrapper(name, kernel, same[-1].symbol))
            table.append(
                f'    {{"{module}", {{"{kernel.name}", (PyCFunction)(void (*)(void)){name}, METH_FASTCALL, '
                f"{json.dumps(_help(kernel))}}}}},"
            )
    initializer = _INITIALIZER.replace("@DIGESTS@", _digests(sources))
    return "\n".join((*functions, "static struct entry ENTRIES[] = {", *table, "};\n", initializer))


def _wrapper(name: str, kernel: KernelEntry, wide: str) -> str:
    """Return a C function that calls a kernel by numba's convention: status returned, result and error by address.

    Args:
        name: Of the C function.
        kernel: For any processor.
        wide: Symbol of the same kernel for processors that can more.
    """
    declared, taken, passed = ["void *", "struct raised **"], [], ["&result", "&raised"]
    for place, (argument, kind) in enumerate(kernel.arguments):
        array = ARRAY.fullmatch(kind)
        if array:
            element, axes = array.group(1), int(array.group(2))
            declared += ["void *", "void *", "int64_t", "int64_t", "void *"] + ["int64_t"] * (2 * axes)
            taken.append(
                f"    PyArrayObject *a{place} = as_array(args[{place}], {NUMPY_TYPES[element]}, {axes}, "
                f'"{kernel.name}", "{argument}");\n    if (a{place} == NULL) return NULL;'
            )
            passed += ["NULL", "NULL"] + [f"PyArray_{what}(a{place})" for what in ("SIZE", "ITEMSIZE", "DATA")]
            passed += [f"PyArray_DIM(a{place}, {axis})" for axis in range(axes)]
            passed += [f"PyArray_STRIDE(a{place}, {axis})" for axis in range(axes)]
        else:
            c_type = C_TYPES[kind]
            via, take = ("double", "as_double") if kind.startswith("float") else ("int64_t", "as_integer")
            take = "as_truth" if c_type == "bool" else take
            declared.append(c_type)
            taken.append(f"    {via} a{place};\n    if (!{take}(args[{place}], &a{place})) return NULL;")
            passed.append(f"({c_type})a{place}")
    result, answer = _result(kernel.result)
    return f"""extern int32_t {kernel.symbol}({", ".join(declared)});
extern int32_t {wide}({", ".join(declared)});
static PyObject *{name}(PyObject *self, PyObject *const *args, Py_ssize_t count) {{
    if (!count_is("{kernel.name}", count, {len(kernel.arguments)})) return NULL;
{chr(10).join(taken)}
    {result};
    struct raised *raised = NULL;
    int32_t status;
    Py_BEGIN_ALLOW_THREADS
    status = (is_wide ? {wide} : {kernel.symbol})({", ".join(passed)});
    Py_END_ALLOW_THREADS
    if (status != 0) return raise_from("{kernel.name}", raised);
    {answer}
}}
"""


def _result(kind: str) -> Tuple[str, str]:
    """Return the declaration of a result and the statement that returns it."""
    several = TUPLE.fullmatch(kind)
    if several:
        element, count = several.group(1), int(several.group(2))
        values = ", ".join(f"{_made('d' if element.startswith('float') else 'L')}result[{i}]" for i in range(count))
        codes = ("d" if element.startswith("float") else "L") * count
        return f"{C_TYPES[element]} result[{count}]", f'return Py_BuildValue("({codes})", {values});'
    if kind == "none":
        return "void *result", "Py_RETURN_NONE;"
    if kind in ("boolean", "bool"):
        return "uint8_t result", "return PyBool_FromLong(result);"
    if kind.startswith("float"):
        return f"{C_TYPES[kind]} result", "return PyFloat_FromDouble(result);"
    return f"{C_TYPES[kind]} result", "return PyLong_FromLongLong(result);"


def _made(code: str) -> str:
    return "(double)" if code == "d" else "(long long)"


def _help(kernel: KernelEntry) -> str:
    return f"{kernel.name}({', '.join(name for name, _ in kernel.arguments)})\n--\n\n{kernel.text}"


def _digests(sources: Mapping[str, str]) -> str:
    return ", ".join(f'"{name}", "{digest}"' for name, digest in sorted(sources.items()))


_INITIALIZER = """static const char *const DIGESTS[] = {@DIGESTS@};

static struct PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "_kernels", "Kernels, compiled.", -1, NULL};

/* Python 3.8's own headers leave it as hidden as all else. */
__attribute__((visibility("default"))) PyMODINIT_FUNC PyInit__kernels(void) {
    import_array();
    is_wide = can_wide();
    PyObject *module = PyModule_Create(&MODULE), *kernels = PyDict_New(), *sources = PyDict_New();
    if (module == NULL || kernels == NULL || sources == NULL) return NULL;
    for (size_t i = 0; i < sizeof(ENTRIES) / sizeof(*ENTRIES); i++)
        if (!add_entry(kernels, &ENTRIES[i])) return NULL;
    for (size_t i = 0; i < sizeof(DIGESTS) / sizeof(*DIGESTS); i += 2) {
        PyObject *digest = PyUnicode_FromString(DIGESTS[i + 1]);
        if (digest == NULL || PyDict_SetItemString(sources, DIGESTS[i], digest) < 0) return NULL;
        Py_DECREF(digest);
    }
    if (PyModule_AddObject(module, "KERNELS", kernels) < 0 || PyModule_AddObject(module, "SOURCES", sources) < 0)
        return NULL;
    return module;
}
"""
