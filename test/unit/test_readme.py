"""The README tells the truth: its links lead somewhere, its commands exist, its examples run."""

import re
import shlex
import sys
import types
from pathlib import Path

import numpy as np
import pytest
import yaml

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning.planner import Cancellation

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def commands():
    for block in blocks("sh"):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            while words:
                end = words.index("&&") if "&&" in words else len(words)
                yield words[:end]
                words = words[end + 1:]


def named():
    """Every `roslaunch`, `rosrun` and script of the README, in code blocks and in running text."""
    found = [command for command in commands() if command]
    found += [shlex.split(text) for text in re.findall(r"`((?:roslaunch|rosrun|scripts/)[^`]*)`", README)]
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
        if words[1] == "mbf_relay" and words[2:] and words[2].isupper() is False and words[2] != "FILE.launch":
            folder = "launch" if words[0] == "roslaunch" else "scripts"
            assert (ROOT / folder / words[2]).is_file(), f"{words[2]} is not in {folder}/"
            if words[0] == "roslaunch":
                launch = (ROOT / folder / words[2]).read_text(encoding="utf-8")
                for argument in words[3:]:
                    assert f'name="{argument.split(":=")[0]}"' in launch, f"{words[2]} has no argument {argument}"


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#]+)\)", README))))
def test_a_link_leads_to_a_file_of_the_repository(target):
    assert target.startswith("http") or (ROOT / target).exists()


@pytest.fixture
def example(monkeypatch):
    """Runs the README's python examples as modules and gives what they define."""

    def load(index):
        module = types.ModuleType(f"readme_example_{index}")
        monkeypatch.setitem(sys.modules, module.__name__, module)
        exec(compile(blocks("python")[index], "README.md", "exec"), module.__dict__)
        return module

    return load


def test_the_example_planner_plans(example):
    kind = example(0).StraightLine
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
    kind = example(1).Shuffle
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
