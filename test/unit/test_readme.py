"""The READMEs tell the truth: their links lead somewhere, their commands exist, their examples run."""

import os
import re
import shlex
import shutil
import subprocess
import sys
import types

import numpy as np
import pytest
import yaml
from readmes import ROOT, block_with, blocks, texts
from tally import LONG

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning.planner import Cancellation


def commands():
    for block in blocks("sh"):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            while words:
                end = words.index("&&") if "&&" in words else len(words)
                yield words[:end]
                words = words[end + 1:]


def named():
    """Every `roslaunch`, `rosrun` and script of the READMEs, in code blocks and in running text."""
    found = [command for command in commands() if command]
    for text in texts().values():
        found += [shlex.split(text) for text in re.findall(r"`((?:roslaunch|rosrun|scripts/\w)[^`]*)`", text)]
    return sorted({" ".join(words) for words in found})


@pytest.mark.parametrize("command", named())
def test_a_command_names_what_there_is(command):
    words = command.split()
    if words[0] == "scripts/run" and len(words) > 1 and words[1] in ("roslaunch", "rosrun"):
        words = words[1:]
    if words[0].startswith("scripts/"):
        assert (ROOT / words[0]).is_file()
    if words[0] in ("roslaunch", "rosrun"):
        words = [word for word in words if not word.startswith("-")]
        if words[1] == "mbf_relay" and words[2:] and not words[2].isupper() and words[2] != "FILE.launch":
            folder = "launch" if words[0] == "roslaunch" else "scripts"
            assert (ROOT / folder / words[2]).is_file(), f"{words[2]} is not in {folder}/"
            if words[0] == "roslaunch":
                launch = (ROOT / folder / words[2]).read_text(encoding="utf-8")
                for argument in words[3:]:
                    assert f'name="{argument.split(":=")[0]}"' in launch, f"{words[2]} has no argument {argument}"


RUN_ELSEWHERE = ("roslaunch", "rosrun", "rostest", "scripts/run", "scripts/demo", "scripts/test", "scripts/benchmark")
"""By system/readme_commands, unit/scripts, system/demo and CI."""


@pytest.mark.parametrize("command", sorted({" ".join(words) for words in commands() if words}))
def test_a_command_is_of_a_kind_that_some_test_runs(command):
    if not command.startswith(RUN_ELSEWHERE):
        assert command in workspace_block() or command in block_with("sh", "scripts/demo        #"), command


def workspace_block():
    """Return the shell block that brings the package into a catkin workspace."""
    return block_with("sh", "catkin_make")


@pytest.fixture
def in_new_home(tmp_path):
    """Return what runs a line of shell in an empty home with a workspace; the repository's URL becomes this checkout.

    What the machine has no program for is left out.
    """
    (tmp_path / "catkin_ws" / "src").mkdir(parents=True)
    environment = dict(
        os.environ, HOME=str(tmp_path), GIT_CONFIG_COUNT="1", GIT_CONFIG_KEY_0="safe.directory", GIT_CONFIG_VALUE_0="*"
    )
    environment["PATH"] = os.pathsep.join(("/usr/bin", environment["PATH"]))  # catkin needs the system's python3
    for made_by_a_build in ("CMAKE_PREFIX_PATH", "ROS_PACKAGE_PATH"):
        environment.pop(made_by_a_build, None)

    def run(line, folder):
        line = line.replace("REPOSITORY_URL", shlex.quote(str(ROOT)))
        parts = [part for part in line.split(" && ") if shlex.split(part)[0] in ("cd", ".") or shutil.which(
            shlex.split(part)[0])]
        done = subprocess.run(
            ["bash", "-ec", " && ".join([*parts, "pwd"])], cwd=str(folder), env=environment, timeout=900,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )
        assert done.returncode == 0, f"'{line}' said:\n{done.stdout}"
        return done.stdout.splitlines()[-1]

    return run


@pytest.mark.skipif(not (ROOT / ".git").exists() or not shutil.which("git"), reason="this is no checkout of git")
def test_the_package_is_cloned_as_the_first_readme_says(in_new_home, tmp_path):
    place = in_new_home(block_with("sh", "scripts/demo        #").splitlines()[0], tmp_path)
    assert os.access(os.path.join(place, "scripts", "demo"), os.X_OK)
    in_new_home(workspace_block().splitlines()[0], tmp_path)
    assert (tmp_path / "catkin_ws" / "src" / "mbf_relay" / "package.xml").is_file()


@pytest.mark.skipif(not LONG, reason="builds the package once more")
def test_the_package_is_built_in_a_workspace_as_the_first_readme_says(in_new_home, tmp_path):
    place = tmp_path
    for line in workspace_block().splitlines()[:3]:
        place = in_new_home(line, place)
    assert (tmp_path / "catkin_ws" / "devel" / "setup.bash").is_file()


LINKS = [(path, target) for path, text in texts().items() for target in sorted(set(re.findall(r"\]\(([^)]+)\)", text)))]


@pytest.mark.parametrize("path, target", LINKS, ids=lambda part: str(part).replace(str(ROOT), ""))
def test_a_link_leads_to_a_file_and_a_heading_of_the_repository(path, target):
    if target.startswith("http"):
        return
    place, _, heading = target.partition("#")
    there = (path.parent / place).resolve() if place else path
    assert there.exists(), f"{path.name} links to {target}"
    if heading:
        guide = there / "README.md" if there.is_dir() else there
        headings = re.findall(r"^#+ (.*)$", guide.read_text(encoding="utf-8"), re.MULTILINE)
        assert heading in {re.sub(r"[^\w -]", "", words.lower()).replace(" ", "-") for words in headings}


def test_who_looks_for_a_room_of_the_house_finds_it_in_the_table():
    source = ROOT / "src" / "mbf_relay"
    rooms = [path.parent.relative_to(source).as_posix() for folder in ("*", "ros/*") for path in source.glob(
        f"{folder}/__init__.py") if path.parent.name != "ros"]
    table = (source / "README.md").read_text(encoding="utf-8")
    assert [room for room in sorted(rooms) if f"`{room}/`" not in table] == []


def test_the_first_readme_is_read_in_ten_minutes():
    assert len(texts()[ROOT / "README.md"].splitlines()) <= 250


@pytest.fixture
def example(monkeypatch):
    """Run the python example that defines a name as a module, and give what it defines."""

    def load(name):
        module = types.ModuleType(f"readme_example_{name}")
        monkeypatch.setitem(sys.modules, module.__name__, module)
        exec(compile(block_with("python", f"class {name}("), "README.md", "exec"), module.__dict__)
        return getattr(module, name)

    return load


def test_the_example_planner_plans(example):
    kind = example("StraightLine")
    planner = kind("straight", kind.Parameters())
    grid = Grid(0.05, 0.0, 0.0, 100, 100)
    costs = np.zeros(grid.shape, dtype=np.uint8)
    footprint = np.array([[-0.1, -0.1], [0.1, -0.1], [0.0, 0.1]])
    costmap = CostGrid(grid, costs, "map", footprint, 0.05, 0.15)
    path = planner.plan(costmap, Pose2D(1.0, 1.0, 0.0), Pose2D(3.0, 1.0, 1.0), 0.0, Cancellation())
    assert path.length == pytest.approx(2.0) and path.goal == Pose2D(3.0, 1.0, 1.0)
    costs[:, 40] = 254
    with pytest.raises(PlanningError) as refused:
        planner.plan(costmap, Pose2D(1.0, 1.0, 0.0), Pose2D(3.0, 1.0, 1.0), 0.0, Cancellation())
    assert refused.value.outcome is PlanOutcome.NO_PATH_FOUND


def test_the_example_recovery_runs_and_ends(example):
    kind = example("Shuffle")
    shuffle = kind("shuffle", kind.Parameters(duration=1.0))

    class Context:
        now = 0.0

    steps = 0
    for velocity in shuffle.run(Context):
        Context.now += 0.1
        steps += 1
        assert velocity.is_finite()
    assert 9 <= steps <= 12


def test_the_yaml_examples_are_yaml():
    assert [yaml.safe_load(block) for block in blocks("yaml")]
