"""Rules of the house that a reader could break without noticing, held by reading the sources."""

import ast
import functools
import re
from pathlib import Path

import pytest

SOURCE = Path(__file__).resolve().parents[2] / "src" / "mbf_relay"
MODULES = sorted(SOURCE.rglob("*.py"))
ROS = re.compile(
    r"^(rospy|roslib|rosgraph|roslaunch|rosbag|rospkg|tf|tf2_\w+|actionlib|dynamic_reconfigure|\w+_msgs|\w+_srvs)$"
)
CLOCKS = {"time.time", "time.monotonic", "time.perf_counter", "time.sleep", "datetime.now", "datetime.utcnow"}
TIMING_ROOMS = {"ros"}


def imports(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module


def room(path):
    return path.relative_to(SOURCE).parts[0]


@functools.lru_cache(maxsize=None)
def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def dotted(node):
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else "?"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_module_imports_only_what_its_room_may(path):
    for name in imports(parsed(path)):
        top = name.split(".")[0]
        if room(path) != "ros":
            assert not ROS.match(top), f"{path.name} imports {name}: only ros/ knows ROS"
            assert not name.startswith("mbf_relay.ros"), f"{path.name} imports {name}: nothing leans on ros/"
        if room(path) != "simulation":
            assert top not in ("pybullet", "pybullet_data"), f"{path.name} imports {name}: only simulation/ knows it"


@pytest.mark.parametrize("path", [p for p in MODULES if room(p) not in TIMING_ROOMS], ids=lambda p: p.name)
def test_no_clock_is_read_and_no_global_chance_used_below_the_ros_edge(path):
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Call):
            name = dotted(node.func)
            assert name not in CLOCKS, f"{path.name}:{node.lineno} reads a clock: take `now` as an argument"
            chance = re.match(r"(np|numpy)\.random\.(?!default_rng|Generator|SeedSequence|PCG64|Philox|seed$)", name)
            drawn = name.startswith("random.") and name != "random.seed"  # seeded for plugins, which may draw
            assert not chance and not drawn, f"{path.name}:{node.lineno} uses global chance"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_modules_are_short_and_documented(path):
    text = path.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 400, f"{path.name} has two jobs"
    assert ast.get_docstring(parsed(path)), f"{path.name} does not say what it is for"


def test_kernels_take_no_number_from_a_module_whose_changes_nobody_would_notice():
    """Their machine code is kept for as long as their own file is as it was; it holds the numbers of others as well."""
    for path in MODULES:
        if path.stem.endswith("_kernels"):
            own = [name for name in imports(parsed(path)) if name.startswith("mbf_relay")]
            assert own == ["mbf_relay.kernels"], f"{path} is compiled with what it imports"


def test_kernels_share_one_decorator():
    for path in MODULES:
        if path.name != "kernels.py":
            assert "njit" not in path.read_text(encoding="utf-8"), (
                f"{path} compiles on its own: use mbf_relay.kernels.kernel"
            )


def test_no_vector_function_takes_a_strided_view():
    # numpy's vectorised cos, sin, exp and their like give results for a view such as poses[:, 2] whose last bit depends
    # on where its memory lies, so that equal drives differ: copy the column first.
    vector = re.compile(r"np\.(cos|sin|tan|exp|log|log1p|arctan|arctan2|power)\([^()]*\w\[[^\]]*[:,]")
    for path in MODULES:
        if room(path) not in TIMING_ROOMS | {"report"}:
            for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
                found = vector.search(line)
                assert not found or " - " in found.group(), f"{path.name}:{number} {line.strip()}"


def test_no_two_test_modules_have_one_name():
    # pytest imports them by their bare names, so one run over two folders would refuse the second.
    names = [
        path.name for folder in ("unit", "contract") for path in (SOURCE.parents[1] / "test" / folder).rglob("*.py")
    ]
    assert sorted({name for name in names if names.count(name) > 1} - {"conftest.py"}) == []


@functools.lru_cache(maxsize=None)
def house_imports():
    """Return what each module of the package imports of the package, wherever in the file it does so."""
    names = {
        ".".join(("mbf_relay", *path.relative_to(SOURCE).with_suffix("").parts)).replace(".__init__", ""): path
        for path in MODULES
    }
    found = {}
    for name, path in names.items():
        found[name] = set()
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "mbf_relay":
                for alias in node.names:
                    full = f"{node.module}.{alias.name}"
                    found[name].add(full if full in names else node.module)
            elif isinstance(node, ast.Import):
                found[name] |= {alias.name for alias in node.names if alias.name in names}
    return found


def test_no_circle_of_imports():
    left = house_imports()
    while True:
        leaves = {name for name, wanted in left.items() if not wanted & set(left)}
        if not leaves:
            break
        left = {name: wanted for name, wanted in left.items() if name not in leaves}
    assert not left, f"these import each other in a circle, or are imported by ones that do: {sorted(left)}"


def test_a_node_imports_no_other_node():
    shared = {("server", "costmap"), ("move_base", "relay"), ("move_base", "server"), ("move_base", "costmap")}
    for name, wanted in house_imports().items():
        parts = name.split(".")
        if len(parts) > 3 and parts[1] == "ros":
            for other in wanted:
                there = other.split(".")
                if len(there) > 3 and there[1] == "ros" and there[2] not in (parts[2], "common"):
                    assert (parts[2], there[2]) in shared, (
                        f"{name} imports {other}: what both need belongs to ros/common/"
                    )


def test_executables_of_nodes_import_nothing_before_they_can_be_ended():
    for path in sorted(path for path in (SOURCE.parents[1] / "scripts").iterdir() if path.is_file()):
        text = path.read_text(encoding="utf-8")
        if "run_node(" in text:
            assert list(imports(ast.parse(text))) == ["mbf_relay.ros.common.node"], (
                f"{path.name}: run_node imports the rest"
            )


def test_one_name_is_one_class():
    found = {}
    for path in MODULES:
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ClassDef) and node.name != "Parameters":
                found.setdefault(node.name, []).append(str(path.relative_to(SOURCE)))
    assert {name: paths for name, paths in found.items() if len(paths) > 1} == {}


def test_what_answers_yes_or_no_returns_whether():
    for path in MODULES:
        for node in ast.walk(parsed(path)):
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                assert not (ast.get_docstring(node) or "").startswith("Tell whether"), f"{path.name}: {node.name}"


def told_arguments(docstring):
    """Return the names under `Args:`, where "x, y: …" says two in one line."""
    section = re.search(r"^Args:\n((?:(?: .*)?\n)*)", docstring + "\n", re.MULTILINE)
    items = re.split(r"\n    (?=\S)", "\n" + section.group(1))[1:]
    return {name for item in items for name in re.findall(r"\w+", item.split(":")[0])}


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(SOURCE)))
def test_a_docstring_tells_of_the_arguments_there_are(path):
    for node in ast.walk(parsed(path)):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and "Args:\n" in (ast.get_docstring(node) or ""):
            made = [each for each in node.body if getattr(each, "name", "") == "__init__"]
            function = node if isinstance(node, ast.FunctionDef) else made[0]
            taken, told = function.args, told_arguments(ast.get_docstring(node))
            several = [each for each in (taken.vararg, taken.kwarg) if each is not None]
            names = {each.arg for each in (*taken.args, *taken.kwonlyargs, *several) if not each.arg.startswith("_")}
            assert told - {"self", "cls"} == names - {"self", "cls"}, f"{path.name}:{node.lineno} {node.name}"
