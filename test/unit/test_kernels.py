"""Kernels that were compiled when the package was built: what they refuse, and when they are not taken."""

import ast
import ctypes
import importlib.util
import os
import subprocess
import sys
import sysconfig
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from tally import LONG

from mbf_relay import kernel_build, kernels
from mbf_relay.kernel_build.wrappers import module_source

TEST = Path(__file__).resolve().parents[1]


@pytest.fixture
def built():
    if importlib.util.find_spec("mbf_relay._kernels") is None:
        pytest.skip("needs the built package")
    return importlib.import_module("mbf_relay._kernels")  # one that is there and cannot be loaded is no reason to skip


@pytest.fixture
def forgetful():
    """Have kernels.py look anew, before and after."""
    def forget():
        kernels._extension.cache_clear()
        kernels._built.cache_clear()
        del kernels._reasons[:]

    forget()
    yield
    forget()


def test_helpers_that_kernels_hold_copies_of_are_alike():
    # numba keeps a compiled file by that file's own change alone, so none may call another's
    helpers = {}
    for path in (TEST.parent / "src").rglob("*_kernels.py"):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and node.name.startswith("_"):
                if ast.get_docstring(node) is not None:
                    node.body = node.body[1:]
                helpers.setdefault(node.name, {})[path.name] = ast.dump(node)
    copies = {name: places for name, places in helpers.items() if len(places) > 1}
    assert {"_differ", "_is_full", "_make_room"} <= set(copies)
    assert [(name, sorted(places)) for name, places in copies.items() if len(set(places.values())) > 1] == []


def test_every_kernel_of_the_package_was_built_from_its_present_source(built):
    assert sorted(built.KERNELS) == kernels.module_names()
    for module, of_module in built.KERNELS.items():
        path = TEST.parent / "src" / (module.replace(".", "/") + ".py")
        assert built.SOURCES[module] == kernels.digest(str(path))
        assert set(of_module) == {
            line[4:line.index("(")] for line in path.read_text().splitlines() if line.startswith("def ")
        }


@pytest.mark.parametrize("cells, distances", [
    (np.zeros((3, 4), np.int8), np.zeros((3, 4), np.float32)),
    (np.zeros((3, 4), np.uint8), np.zeros((3, 4))),
    (np.zeros(12, np.uint8), np.zeros((3, 4), np.float32)),
    (np.zeros((3, 8), np.uint8)[:, ::2], np.zeros((3, 4), np.float32)),
    (np.zeros((3, 4), np.uint8), np.broadcast_to(np.float32(0.0), (3, 4))),
    ([[0]], np.zeros((1, 1), np.float32)),
])
def test_an_array_of_another_kind_is_refused_and_never_read_past_its_end(built, cells, distances):
    with pytest.raises(TypeError, match="distances_to_zeros takes as (cells|distances)"):
        built.KERNELS["mbf_relay.distance_kernels"]["distances_to_zeros"](cells, 7, distances)


def test_arguments_too_few_too_many_or_no_numbers_are_refused(built):
    axis = built.KERNELS["mbf_relay.control.trajectory_kernels"]["axis"]
    values = np.zeros(10)
    for arguments in ((0.0, 1.0, 3), (0.0, 1.0, 3, values, 1), (0.0, "1", 3, values), (0.0, 1.0, 3.0, values)):
        with pytest.raises(TypeError):
            axis(*arguments)
    with pytest.raises(ZeroDivisionError, match="division by zero"):
        axis(0.0, 1.0, 1, values)


def test_a_kernel_changed_since_the_build_is_compiled_anew_and_says_so_once(forgetful, monkeypatch, tmp_path):
    source = tmp_path / "late_kernels.py"
    source.write_text("".join(
        f'@kernel("float64(float64)")\ndef {name}(x):\n    return {factor} * x\n'
        for name, factor in (("twice", 2.0), ("thrice", 3.0))))
    found = {"mbf_relay.late_kernels": {"twice": float, "thrice": int}}
    old = SimpleNamespace(SOURCES={"mbf_relay.late_kernels": "0"}, KERNELS=found)
    monkeypatch.setitem(sys.modules, "mbf_relay._kernels", old)

    def imported():
        module = ModuleType("mbf_relay.late_kernels")
        monkeypatch.setitem(sys.modules, module.__name__, module)  # where older numbas look for it
        module.kernel = kernels.kernel
        exec(compile(source.read_text(), str(source), "exec"), module.__dict__)
        return module.twice, module.thrice

    twice, thrice = imported()  # once: what numba takes twice from its cache crashes on arm64
    assert (twice(2.0), thrice(2.0)) == (4.0, 6.0)
    assert kernels._reasons == [
        "mbf_relay.late_kernels has changed since the kernels were built: build the package again"
    ]
    old.SOURCES["mbf_relay.late_kernels"] = kernels.digest(str(source))
    kernels._built.cache_clear()
    assert imported() == (float, int)


@pytest.mark.parametrize("error", [ImportError("undefined symbol"), RuntimeError("compiled against another numpy")])
def test_an_extension_of_another_python_or_numpy_is_not_the_end(forgetful, monkeypatch, error):
    def fail(name):
        raise error

    monkeypatch.setattr(kernels.importlib, "import_module", fail)
    assert kernels._built("mbf_relay.distance_kernels", __file__) == {}
    assert str(error) in kernels.reason_in_process()


@pytest.mark.skipif(not LONG, reason="numba compiles every kernel: minutes")
def test_built_kernels_are_equal_to_numbas_to_the_last_bit(built):
    rooms = ["control", "costmap", "localization", "planning", "tracking", "simulation", "test_distances.py"]
    folders = [f"unit/{room}" for room in rooms] + ["contract"]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "shadow_kernels", *folders], cwd=TEST,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=dict(os.environ, PYTHONPATH=os.pathsep.join(
            [str(TEST), os.environ.get("PYTHONPATH", "")])),
    )
    text = done.stdout.decode(errors="replace")
    assert done.returncode == 0, text[-4000:]
    assert "kernels compared" in text


def test_kernels_for_any_processor_give_the_bits_of_those_for_wide_vectors():
    program = (
        "import hashlib, numpy as np; from mbf_relay.costmap import inflation_kernels as k;"
        "costs = (np.random.default_rng(0).random((90, 130)) < 0.01).astype(np.uint8) * np.uint8(254);"
        "k.inflate(costs, 0, 0, 130, 90, np.arange(401, dtype=np.uint8), 20, True);"
        "print(hashlib.sha256(costs).hexdigest())"
    )
    told = {
        subprocess.run(
            [sys.executable, "-c", program], env={**os.environ, kernels.SWITCH: choice}, capture_output=True, text=True,
            check=True).stdout
        for choice in ("", kernels.PLAIN)}
    assert len(told) == 1


def test_who_builds_does_not_wait_for_kernels_compiled_for_a_list_of_parameters():
    told = f"{kernels.SWITCH}={kernels.UNCOMPILED}"
    assert told in (TEST.parent / "CMakeLists.txt").read_text(encoding="utf-8")
    program = "import sys; sys.modules['numba'] = None; import mbf_relay.planning.global_planner"
    subprocess.run(["env", told, sys.executable, "-c", program], check=True)


def test_a_build_that_was_copied_to_a_robot_with_another_processor_compiles_its_kernels_anew(monkeypatch, tmp_path):
    """It linked the PC's, which failed, and each node compiled every kernel by itself."""
    from mbf_relay.kernel_build import __main__ as build

    def place(machine):
        monkeypatch.setattr("platform.machine", lambda: machine)
        return build._object(tmp_path, {"mbf_relay.late_kernels": ""}, "mbf_relay.late_kernels", "")

    assert place("x86_64") == place("x86_64") != place("aarch64")


def test_a_module_that_cannot_be_loaded_fails_the_build_and_not_the_nodes(tmp_path):
    from mbf_relay.kernel_build.__main__ import _require_loadable

    broken = tmp_path / "_kernels.so"
    broken.write_bytes(b"no machine code")
    with pytest.raises(subprocess.CalledProcessError) as refused:
        _require_loadable(broken)
    assert str(broken) in refused.value.stderr and "Traceback" not in refused.value.stderr


def test_kernels_are_compiled_ahead_where_pythons_headers_leave_the_module_hidden(tmp_path):
    """As 3.8's do: nodes on Noetic's own Ubuntu compiled every kernel by themselves, and held numba for it."""
    source = tmp_path / "kernels.c"
    headers = "#include <Python.h>\n#undef PyMODINIT_FUNC\n#define PyMODINIT_FUNC PyObject *\n"
    support = (Path(kernel_build.__file__).parent / "support.c").read_text(encoding="utf-8")
    source.write_text(headers + support + module_source({}, {}), encoding="utf-8")
    target = tmp_path / "_kernels.so"
    subprocess.run(
        ["cc", "-shared", "-fPIC", "-fvisibility=hidden", "-I", sysconfig.get_paths()["include"],
         "-I", np.get_include(), str(source), "-o", str(target)], check=True)
    assert hasattr(ctypes.CDLL(str(target)), "PyInit__kernels")
