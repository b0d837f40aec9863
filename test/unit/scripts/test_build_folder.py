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


def ask(name, folder, *others, **environment):
    """Call one of the script's own functions, which calls some others of them, with a folder."""
    return call(f'{name} "$1"', folder, name, *others, **environment)


def call(command, folder, *names, **environment):
    text = RUN.read_text(encoding="utf-8")
    functions = [re.search(rf"^{each}\(\) \{{([^\n]*\}}$|.*?^\}})", text, re.MULTILINE | re.DOTALL).group()
                 for each in names]
    return subprocess.run(
        ["bash", "-uc", "\n".join([*functions, command]), "bash", str(folder)],
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


class Build:
    """A checkout with one file of some name, and a build of it."""

    def __init__(self, folder, name):
        self.workspace, self.edited = folder / "workspace", folder / "checkout" / name
        self.made = self.workspace / "build" / "stamp"
        for path in (self.edited, self.made):
            path.parent.mkdir(parents=True)
            path.touch()
        self._environment = {"workspace": str(self.workspace), "checkout": str(folder / "checkout")}
        self.note()
        (self.workspace / "building").replace(self.workspace / "built")

    def note(self):
        """Note what is built now, as each build does before it begins."""
        found = ask("built_from", "", **self._environment)
        (self.workspace / "building").write_text(found.stdout)

    def is_built(self):
        """Return whether all is as it was then."""
        return ask("is_built", "", "built_from", **self._environment).returncode == 0

    def begin(self):
        """Begin to build; return whether make, which goes by times, makes anew what is made from the file."""
        self.note()
        assert ask("age_build", "", **self._environment).returncode == 0
        return self.made.stat().st_mtime < self.edited.stat().st_mtime


@pytest.mark.parametrize("name, is_to_be_built", [
    ("src/mbf_relay/kernel_build/support.c", True), ("src/mbf_relay/kernels.py", True), ("scripts/amcl", True),
    ("action/srv/CheckPoint.srv", True), ("config/amcl.yaml", False), ("launch/demo.launch", False)])
def test_what_was_edited_is_built_anew_where_the_build_holds_something_of_it(tmp_path, name, is_to_be_built):
    """The C source that kernels are wrapped in was not: tests of an edit of it passed with what had been built before.
    """
    build = Build(tmp_path, name)
    assert build.is_built()
    os.utime(build.edited, (4e9, 4e9))
    assert build.is_built() == (not is_to_be_built)
    build.edited.unlink()
    assert build.is_built() == (not is_to_be_built)


def test_a_robot_runs_what_rsync_brought_though_it_was_built_there_after_that_was_edited(tmp_path):
    """Kernels and messages stayed as they were, and `build the package again`, which the log asked for, did nothing."""
    build = Build(tmp_path, "src/mbf_relay/kernels.py")
    os.utime(build.edited, (1e9, 1e9))
    assert not build.is_built() and build.begin()


def test_what_an_edit_does_not_concern_is_not_built_anew(tmp_path):
    build = Build(tmp_path, "src/mbf_relay/kernels.py")
    before = build.made.stat().st_mtime
    os.utime(build.edited, (4e9, 4e9))
    build.begin()
    assert build.made.stat().st_mtime == before


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


def test_a_container_that_is_given_the_home_does_not_run_what_the_machine_has_built(tmp_path):
    """Noetic's container ran nodes by an interpreter that only Debian has, and neither of the two built anew."""
    told = []
    for name in ("debian", "ubuntu"):
        release, run = tmp_path / f"{name}-release", tmp_path / "checkout" / "scripts" / "run"
        release.write_text(f"ID={name}\nVERSION_ID=20.04\n")
        run.parent.mkdir(parents=True, exist_ok=True)
        run.write_text(RUN.read_text(encoding="utf-8").replace("/etc/os-release", str(release)), encoding="utf-8")
        told.append(subprocess.run(
            ["bash", str(run), "--where"], env={"PATH": os.environ["PATH"], "HOME": str(tmp_path)}, check=True,
            stdout=subprocess.PIPE, text=True, timeout=60.0).stdout)
    assert told[0] != told[1]


def test_a_robot_that_is_given_the_home_of_a_pc_does_not_run_what_that_has_built(tmp_path):
    """Its simulator did not start, for want of a PyBullet, and each of its nodes compiled every kernel by itself."""
    uname, places = tmp_path / "uname", []
    for processor in ("x86_64", "aarch64"):
        uname.write_text(f"#!/bin/sh\necho {processor}\n", encoding="utf-8")
        uname.chmod(0o755)
        workspace = where(HOME=str(tmp_path), PATH=f"{tmp_path}:{os.environ['PATH']}").stdout
        begun = call(  # as far as the first command that changes something
            'rm() { exit; }; say() { echo "$*"; }; make_interpreter', "", "make_interpreter", cache=str(tmp_path),
            processor=processor).stdout
        assert workspace.startswith(str(tmp_path)) and str(tmp_path) in begun
        places.append((workspace, begun))
    assert all(pc != robot for pc, robot in zip(*places))


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
