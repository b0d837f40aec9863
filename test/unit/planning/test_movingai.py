"""Public problems with known optimal lengths (movingai.com's benchmark); skipped where the data is not at hand."""

import math
import os
import pathlib

import numpy as np
import pytest

from mbf_relay import plugins
from mbf_relay.costmap.cost_grid import LETHAL, CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.planning import PLANNERS
from mbf_relay.planning.planner import Cancellation, Planner

REPOSITORY = pathlib.Path(__file__).resolve().parents[3]
SHARED = pathlib.Path(os.environ.get("MBF_RELAY_SHARED", str(REPOSITORY.parent / "shared")))
DATA = SHARED / "data" / "movingai"
NAMES = ("arena", "den312d", "Berlin_0_256")

pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"no {DATA}")


def load_map(path):
    """Return a map of the benchmark as a snapshot of costs, its first line as row 0."""
    lines = path.read_text().split("map\n", 1)[1].split()
    free = np.array([[letter in ".GS" for letter in line] for line in lines])
    costs = np.where(free, 0, LETHAL).astype(np.uint8)
    return CostGrid(Grid(1.0, 0.0, 0.0, costs.shape[1], costs.shape[0]), costs, "map", np.zeros((0, 2)), 0.5, 0.5)


def load_problems(path):
    """Return start, goal and optimal length of each problem."""
    rows = [line.split() for line in path.read_text().splitlines()[1:] if line.strip()]
    return [((int(r[4]), int(r[5])), (int(r[6]), int(r[7])), float(r[8])) for r in rows]


def at(cell):
    return Pose2D(cell[0] + 0.5, cell[1] + 0.5, 0.0)


def octile_length(path):
    steps = np.abs(np.diff(path.poses[:, :2], axis=0))
    straight, diagonal = (steps.sum(axis=1) == 1.0).sum(), (steps.sum(axis=1) == 2.0).sum()
    assert straight + diagonal == len(steps)
    return straight + math.sqrt(2.0) * diagonal


@pytest.fixture(scope="module", params=NAMES)
def problems(request):
    costmap = load_map(DATA / f"{request.param}.map")
    return costmap, load_problems(DATA / f"{request.param}.map.scen")


def test_every_problem_is_solved_at_its_optimal_length(problems):
    costmap, cases = problems
    planner = plugins.create("p", "global_planner/GlobalPlanner", {"use_grid_path": True}, Planner, PLANNERS)
    assert len(cases) > 100
    for start, goal, optimum in cases:
        path = planner.plan(costmap, at(start), at(goal), 0.0, Cancellation())
        # the files give six digits
        assert octile_length(path) == pytest.approx(optimum, rel=6e-6, abs=1e-5), (start, goal)
        assert path.cost / 50.0 == pytest.approx(octile_length(path))


def test_lines_at_any_angle_are_never_longer(problems):
    costmap, cases = problems
    planner = plugins.create("p", "any_angle", {}, Planner, PLANNERS)
    gained = []
    for start, goal, optimum in cases[::7]:
        path = planner.plan(costmap, at(start), at(goal), 0.0, Cancellation())
        assert path.length <= optimum + 1e-4, (start, goal)
        gained.append(path.length / max(optimum, 1e-9))
    assert np.mean([ratio for ratio in gained if ratio > 0.0]) < 0.98


def test_fast_marching_comes_close_to_the_straightest_way(problems):
    costmap, cases = problems
    planner = plugins.create("p", "navfn/NavfnROS", {}, Planner, PLANNERS)
    for start, goal, optimum in cases[::11]:
        path = planner.plan(costmap, at(start), at(goal), 0.0, Cancellation())
        assert path.length <= 1.06 * optimum + 1.0, (start, goal)
