"""Every executable says what it is for and what it takes."""

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from ros_testing import wait_until

ROOT = Path(__file__).resolve().parents[3]
FILE = ROOT / "config" / "move_base_flex.yaml"
EXECUTABLES = sorted(path for path in (ROOT / "scripts").iterdir() if path.is_file() and os.access(path, os.X_OK))


@pytest.fixture(scope="module")
def programs():
    """Where rosrun finds programs; it is asked once, for it looks for half a second of a core."""
    found = subprocess.check_output(["catkin_find", "--without-underlays", "--first-only", "--libexec", "mbf_relay"])
    return Path(found.decode().strip())


@pytest.mark.parametrize("path", EXECUTABLES, ids=lambda path: path.name)
def test_help_explains_the_arguments_without_a_ros_master(path, programs):
    is_for_the_checkout = path.name in ("demo", "test", "run", "benchmark", "package")
    command = path if is_for_the_checkout else programs / path.name
    environment = dict(os.environ, ROS_MASTER_URI="http://localhost:1")
    done = subprocess.run(
        [str(command), "--help"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=environment, timeout=120.0)
    text = done.stdout.decode(errors="replace")
    assert done.returncode == 0, text
    assert len(text) > 60 and "Traceback" not in text


@pytest.mark.parametrize("name", ["velocity_guard", "simulator", "move_base_flex"])
def test_help_of_a_node_says_where_its_topics_and_parameters_stand(name, programs):
    """It told of the threads inside, and of nothing that somebody who starts it can set or connect."""
    text = subprocess.run(
        [str(programs / name), "--help"], stdout=subprocess.PIPE, check=True, timeout=120.0).stdout.decode()
    for folder in re.findall(r"(\w+)/README\.md", text):
        assert name in (ROOT / folder / "README.md").read_text(encoding="utf-8")
    assert "config/README.md" in text and "hread" not in text


@pytest.mark.parametrize("name, arguments, status, said", [
    ("map_server", (), 1, "0 arguments given; usage: map_server MAP.yaml"),
    ("map_saver", ("-f",), 2, "argument -f: expected one argument"),
    ("map_saver", ("--occ", "30", "--free", "60"), 1, "--occ is 30 and --free is 60"),
    ("amcl", ("map.yaml",), 2, "unrecognized arguments: map.yaml"),
    ("amcl", ("--global-localization",), 2, "--global-localization needs --run-from-bag"),
    ("movebase_client.py", ("--timeout", "0"), 1, "no ROS master at http://localhost:1 within 0 s"),
    ("mbf_path_client.py", ("--timeout", "-3"), 2, "argument --timeout: -3 is below 0"),
    ("movebase_client.py", ("left",), 2, "argument x: 'left' is no finite number"),
])
def test_what_is_wrong_on_a_command_line_is_said_without_a_ros_master(name, arguments, status, said, programs):
    """Each waited for a master first, the clients for ever, and said what was wrong with it once there was one."""
    done = subprocess.run(
        [str(programs / name), *arguments], stderr=subprocess.PIPE, timeout=120.0,
        env=dict(os.environ, ROS_MASTER_URI="http://localhost:1"))
    assert done.returncode == status and said in done.stderr.decode(), done.stderr.decode()


@pytest.mark.parametrize("name", ["move_base_flex", "amcl", "localize_log.py", "compose"])
def test_a_numpy_that_pip_put_before_the_systems_is_named_instead_of_a_page_of_tracebacks(name, programs, tmp_path):
    """Libraries are made for another one: a user was shown the inside of numba, and not whose NumPy was in the way."""
    for library in ("numba", "scipy", "PIL"):
        (tmp_path / f"{library}.py").write_text("raise ImportError('numpy.core.multiarray failed to import')\n")
    done = subprocess.run(
        [str(programs / name), *(["--no-respawn", "--", "move_base_flex"] if name == "compose" else [])],
        stderr=subprocess.PIPE, timeout=120.0,
        env=dict(os.environ, ROS_MASTER_URI="http://localhost:1", MBF_RELAY_KERNELS="in process",
                 PYTHONPATH=f"{tmp_path}:{os.environ['PYTHONPATH']}"))
    said = done.stderr.decode()
    assert done.returncode == 1 and f"{name} cannot start with " in said and "Traceback" not in said, said
    assert "numpy.core.multiarray failed to import" in said


def test_an_argument_that_a_node_does_not_take_is_said_to_be_ignored(programs):
    """`simulator --seed 3` began with another seed and said nothing."""
    with subprocess.Popen(
        [str(programs / "simulator"), "--seed", "3"], stderr=subprocess.PIPE,
        env=dict(os.environ, ROS_MASTER_URI="http://localhost:1"),
    ) as node:
        first = node.stderr.readline().decode()
        node.terminate()
    assert "simulator: '--seed' is ignored" in first and "_name:=value" in first


ENDED_BY = {
    signal.SIGPIPE: (("parameter_tables.py",), ("robot_description.py", "waffle"), ("check_config.py", str(FILE))),
    signal.SIGINT: (("make_worlds.py", "--kind", "office", "--count", "100000"), ("train_policy.py",)),
}


@pytest.mark.parametrize("number, line", [(number, line) for number, lines in ENDED_BY.items() for line in lines])
def test_ctrl_c_and_a_reader_that_has_gone_show_nobody_a_traceback(number, line, programs, tmp_path):
    """`… | head` ended with BrokenPipeError, Ctrl-C with a page of whatever was being done."""
    reader, writer = os.pipe()
    with subprocess.Popen(
        [str(programs / line[0]), *line[1:]], stdout=writer, stderr=subprocess.PIPE, cwd=str(tmp_path)
    ) as command:
        os.close(writer)
        if number == signal.SIGPIPE:
            os.close(reader)
        else:
            maps = Path(f"/proc/{command.pid}/maps")
            wait_until(lambda: "numpy" in maps.read_text(), "the command's own imports", 60.0)
            command.send_signal(number)
            os.close(reader)
        said = command.stderr.read().decode()
    assert command.returncode == -number and "Error" not in said and "Traceback" not in said, said
    assert list(tmp_path.iterdir()) == []


def test_a_robots_memory_is_not_filled_with_libraries_no_node_needs():
    places = [re.search(r'run_node\(.*"(mbf_relay[\w.]+)\.\w+"', path.read_text()) for path in EXECUTABLES]
    nodes = sorted({place.group(1) for place in places if place and ".tools." not in place.group(1)})
    assert len(nodes) >= 8, nodes
    # and what a node imports when its parameters name it
    rooms = ("control", "costmap", "navigation", "planning", "recovery", "tracking")
    plugins = [
        ".".join(("mbf_relay", *path.relative_to(ROOT / "src" / "mbf_relay").with_suffix("").parts))
        for room in rooms for path in (ROOT / "src" / "mbf_relay" / room).rglob("*.py")
    ]
    code = (
        "import importlib, sys; from mbf_relay.ros.common.rospy_patches.lazy_modules import *; "
        "import_lazily(); "
        f"[importlib.import_module(name) for name in {nodes + plugins}]; "
        "print(*(name for name, module in sys.modules.items() if type(module) is not LazyModule))"
    )
    done = subprocess.run([sys.executable, "-c", code], stdout=subprocess.PIPE, check=True, timeout=60.0)
    unused = {"cv2", "matplotlib", "numba", "llvmlite", "scipy", "pyparsing", "numpy.ma", "numpy.polynomial"}
    assert unused & set(done.stdout.decode().split()) == set()


def test_what_the_navigation_on_a_robot_does_not_use_takes_no_memory(tmp_path):
    # As the executables start: what run_node imports before it spares anything would be there all the same.
    nodes = [f"mbf_relay.ros.{name}.node" for name in ("map_server", "amcl", "server", "relay")]
    (tmp_path / "probe.py").write_text(
        "import importlib, sys\nfrom mbf_relay.ros.common.rospy_patches.lazy_modules import LazyModule\n"
        f"for name in {nodes}:\n    importlib.import_module(name)\n"
        "USAGE = ' '.join(name for name, module in list(sys.modules.items()) if type(module) is not LazyModule)\n"
    )
    code = "from mbf_relay.ros.common.node import run_node; run_node('probe', 'probe.main')"
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    done = subprocess.run(
        [sys.executable, "-c", code, "--help"], stdout=subprocess.PIPE, check=True, env=environment, timeout=60.0)
    found = set(done.stdout.decode().split())
    assert "rospy" in found and "nav_msgs.msg._OccupancyGrid" in found
    unused = {
        "PIL", "defusedxml", "difflib", "html.entities", "importlib.resources.abc", "ipaddress", "pydoc",
        "sensor_msgs.msg._Imu", "ssl", "statistics", "visualization_msgs.msg._InteractiveMarker",
        "xml.dom.minidom",
    }
    numpy = subprocess.run(  # Ubuntu 20.04's needs some of it itself
        [sys.executable, "-c", "import numpy, sys; print(*sys.modules)"], stdout=subprocess.PIPE, check=True,
        timeout=60.0)
    assert unused & found - set(numpy.stdout.decode().split()) == set()


def test_algebra_on_small_matrices_keeps_no_other_core_of_the_robot_busy(tmp_path):
    # OpenBLAS's threads wait in a loop: with one more of them amcl took thrice the processor time.
    (tmp_path / "probe.py").write_text(
        "import os, numpy\nnumpy.ones((500, 500)) @ numpy.ones((500, 500))\n"
        "USAGE = f'threads {len(os.listdir(\"/proc/self/task\"))}'\n"
    )
    code = "from mbf_relay.ros.common.node import run_node; run_node('probe', 'probe.main')"
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    environment.pop("OPENBLAS_NUM_THREADS", None)
    done = subprocess.run(
        [sys.executable, "-c", code, "--help"], stdout=subprocess.PIPE, check=True, env=environment, timeout=60.0
    )
    assert done.stdout.decode().strip() == "threads 2"  # this one, and the one that waits for signals
