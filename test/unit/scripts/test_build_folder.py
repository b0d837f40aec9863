"""Where scripts/run builds: a folder of the user's own, because what lies there is run."""

import os
import re
import stat
import subprocess
from pathlib import Path

import pytest

RUN = Path(__file__).resolve().parents[3] / "scripts" / "run"
FALLBACK = Path(f"/var/tmp/mbf_relay-{os.getuid()}")
NOBODY = 65534


def ask(name, folder, **environment):
    """Call one of the script's own functions with a folder."""
    function = re.search(
        rf"^{name}\(\) \{{.*?^\}}", RUN.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    ).group()
    return subprocess.run(
        ["bash", "-uc", f'{function}\n{name} "$1"', "bash", str(folder)],
        env={"PATH": os.environ["PATH"], **environment}, stdout=subprocess.PIPE, text=True)


def is_own(folder):
    return ask("is_own_folder", folder).returncode == 0


def where(**environment):
    left = {name: value for name, value in os.environ.items() if name not in ("HOME", "XDG_CACHE_HOME")}
    existed = FALLBACK.exists()
    try:
        return subprocess.run(
            [str(RUN), "--where"], env={**left, **environment}, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, timeout=60.0,
        )
    finally:
        if not existed and FALLBACK.is_dir() and not FALLBACK.is_symlink():
            for path in FALLBACK.iterdir():
                path.rmdir()
            FALLBACK.rmdir()


@pytest.mark.parametrize("name, is_to_be_built", [
    ("src/mbf_relay/kernel_build/support.c", True), ("src/mbf_relay/kernels.py", True), ("scripts/amcl", True),
    ("action/srv/CheckPoint.srv", True), ("config/amcl.yaml", False), ("launch/demo.launch", False)])
def test_what_was_edited_is_built_anew_where_the_build_holds_something_of_it(tmp_path, name, is_to_be_built):
    """The C source that kernels are wrapped in was not: tests of an edit of it passed with what had been built before.
    """
    workspace, edited = tmp_path / "workspace", tmp_path / "checkout" / name
    edited.parent.mkdir(parents=True)
    edited.touch()
    workspace.mkdir()
    (workspace / "built").touch()
    environment = {"workspace": str(workspace), "checkout": str(tmp_path / "checkout")}
    os.utime(edited, (1e9, 1e9))
    assert ask("is_built", "", **environment).returncode == 0
    os.utime(edited, (4e9, 4e9))
    assert ask("is_built", "", **environment).returncode == int(is_to_be_built)


def test_a_new_folder_is_open_to_its_owner_alone(tmp_path):
    folder = tmp_path / "cache" / "mbf_relay"
    assert is_own(folder)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


def test_a_folder_others_could_only_read_is_closed_to_them(tmp_path):
    tmp_path.chmod(0o755)
    assert is_own(tmp_path)
    assert stat.S_IMODE(tmp_path.stat().st_mode) == 0o700


def test_a_folder_that_anybody_could_write_to_is_not_trusted(tmp_path):
    tmp_path.chmod(0o1777)
    assert not is_own(tmp_path)


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a folder away")
def test_a_folder_that_another_user_planted_is_not_trusted(tmp_path):
    os.chown(str(tmp_path), NOBODY, NOBODY)
    assert not is_own(tmp_path)


def test_the_build_lies_under_the_users_cache(tmp_path):
    assert where(XDG_CACHE_HOME=str(tmp_path)).stdout.startswith(f"{tmp_path}/mbf_relay/")
    assert where(HOME=str(tmp_path)).stdout.startswith(f"{tmp_path}/.cache/mbf_relay/")


@pytest.mark.skipif(FALLBACK.exists() or FALLBACK.is_symlink(), reason=f"{FALLBACK} is in use")
@pytest.mark.parametrize("environment", [{}, {"HOME": "/proc/none"}, {"HOME": "/proc"}, {"HOME": "/dev/null"}])
def test_without_a_home_that_can_be_written_it_lies_beside(environment):
    found = where(**environment)
    assert found.returncode == 0 and found.stdout.startswith(f"{FALLBACK}/"), found.stdout


@pytest.mark.skipif(FALLBACK.exists() or FALLBACK.is_symlink(), reason=f"{FALLBACK} is in use")
def test_a_link_in_the_place_of_the_folder_beside_is_refused_in_words(tmp_path):
    FALLBACK.symlink_to(tmp_path)
    try:
        found = where()
        assert found.returncode == 1 and "is a link" in found.stdout and not list(tmp_path.iterdir())
    finally:
        FALLBACK.unlink()


@pytest.mark.parametrize("environment, place", [
    ({"HOME": "/proc"}, "{cache}/ros"), ({"HOME": "/dev/null"}, "{cache}/ros"), ({}, "{cache}/.ros"),
    ({"HOME": "{cache}"}, "{cache}/.ros"), ({"HOME": "/proc", "ROS_HOME": "{cache}/mine"}, "{cache}/mine"),
])
def test_nodes_start_where_the_home_cannot_be_written(tmp_path, environment, place):
    environment = {name: value.format(cache=tmp_path) for name, value in environment.items()}
    found = ask("ros_home", tmp_path, **environment).stdout.strip()
    assert found == place.format(cache=tmp_path)


def test_a_planner_of_ones_own_is_found_beside(tmp_path):
    """--with took folders of ROS packages, and the planner in one of them could not be loaded."""
    for folder in (tmp_path, tmp_path / "my_robot" / "src" / "my_robot", tmp_path / "no module's"):
        folder.mkdir(parents=True, exist_ok=True)
    for module in (tmp_path / "my_planners.py", tmp_path / "my_robot" / "src" / "my_robot" / "__init__.py"):
        module.touch()
    found = ask("python_folders", tmp_path).stdout
    done = subprocess.run(
        ["python3", "-Bc", "import my_planners, my_robot"], env={"PATH": os.environ["PATH"], "PYTHONPATH": found},
        cwd="/", stderr=subprocess.PIPE, text=True)
    assert done.returncode == 0, done.stderr
