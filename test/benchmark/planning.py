"""Global planning: times on small to huge maps, replanning, cancelling, lengths on public problems, memory."""

from __future__ import annotations

import dataclasses
import sys
import threading
import time
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Tuple

import numpy as np

from benchmark import planning_peers
from benchmark.arena import GOAL, START, arena_costmap
from benchmark.metric import Metric, NotMeasurable, metric_of, time_call
from benchmark.processes import told_by
from benchmark.public_data import public_data
from mbf_relay import plugins
from mbf_relay.costmap.cost_grid import LETHAL, CostGrid
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.outcomes import PlanningError
from mbf_relay.planning import PLANNERS
from mbf_relay.planning.passage import touching_cells
from mbf_relay.planning.planner import Cancellation, Planner

CASES: Mapping[str, Tuple[str, Dict[str, Any]]] = {
    "navfn": ("navfn/NavfnROS", {}),
    "global_planner": ("global_planner/GlobalPlanner", {}),
    "grid path": ("global_planner/GlobalPlanner", {"use_grid_path": True, "cost_factor": 0.8}),
    "any angle": ("any_angle", {}),
}
SCALES = (1, 4, 10)
HUGE = 10000
MAPS = ("arena", "den312d", "Berlin_0_256")


def make(case: str) -> Planner:
    """Return a planner that knows nothing yet."""
    type_name, values = CASES[case]
    return plugins.create(case, type_name, values, Planner, PLANNERS)


def metrics(quick: bool) -> Iterator[Metric]:
    """Yield times, lengths and memory."""
    for scale in SCALES[:2] if quick else SCALES:
        costmap = arena_costmap(scale)
        for case in CASES:
            yield _from_scratch(case, costmap, 5 if quick else 25)
            yield _again(case, costmap, 5 if quick else 25)
            yield _after_change(case, scale, 3 if quick else 15)
        yield _second_look(costmap, 5 if quick else 25)
        yield from planning_peers.metrics(costmap, 1 if quick else 5)
    for case in CASES:
        yield _cancel(case, 3 if quick else 10)
    yield from _lengths(31 if quick else 1)
    if not quick:
        yield from _huge()


def _plan(planner: Planner, costmap: CostGrid, start: Pose2D = START, goal: Pose2D = GOAL) -> Any:
    return planner.plan(costmap, start, goal, 0.0, Cancellation())


def _size(costmap: CostGrid) -> str:
    return f"{costmap.grid.width} x {costmap.grid.height}"


def _from_scratch(case: str, costmap: CostGrid, repeats: int) -> Metric:
    """Time whole calls for goals never planned to before; memory is kept between them, as in a running server."""
    planner = make(case)
    path = _plan(planner, costmap)
    elsewhere = Pose2D(GOAL.x + costmap.grid.resolution, GOAL.y, GOAL.theta)
    goals = [GOAL, elsewhere]
    calls = [0]

    def plan() -> None:
        calls[0] += 1
        _plan(planner, costmap, START, goals[calls[0] % 2])

    return time_call(
        f"plan {_size(costmap)}, {case}", plan, repeats, "ms", 2, path_m=round(path.length, 3), poses=len(path)
    )


def _again(case: str, costmap: CostGrid, repeats: int) -> Metric:
    """Time a replan of a robot under way: unchanged map and goal."""
    planner = make(case)
    path = _plan(planner, costmap)
    under_way = Pose2D(*map(float, path.poses[len(path) // 8]))
    return time_call(
        f"replan {_size(costmap)}, {case}, nothing changed", lambda: _plan(planner, costmap, under_way), repeats
    )


def _after_change(case: str, scale: int, repeats: int) -> Metric:
    """Time a replan after a robot met something 0.1 m wide on its way, as it comes and goes."""
    planner, costmap = make(case), arena_costmap(scale)
    path = _plan(planner, costmap)
    x, y = (float(value) for value in path.poses[len(path) // 6, :2])
    snapshots = [  # of no revision: what changed has to be looked for
        dataclasses.replace(seen, revision=0) for seen in (costmap, arena_costmap(scale, obstacle=(x, y)))]
    calls = [0]

    def replan() -> None:
        calls[0] += 1
        _plan(planner, snapshots[calls[0] % 2])

    return time_call(f"replan {_size(costmap)}, {case}, local change", replan, repeats)


def _second_look(costmap: CostGrid, repeats: int) -> Metric:
    """Time what looking for passages too narrow for the footprint adds to each plan."""
    path = _plan(make("navfn"), costmap)
    checker = FootprintChecker(costmap, unknown_touches=False)
    return time_call(
        f"narrow passages {_size(costmap)}", lambda: touching_cells(checker, path), repeats, poses=len(path))


def _cancel(case: str, repeats: int) -> Metric:
    """Time from a cancel to the end of a long plan."""
    costs = np.zeros((3000, 3000), dtype=np.uint8)
    costs[1::4, :-1] = LETHAL
    costs[3::4, 1:] = LETHAL
    costmap = CostGrid(Grid(0.05, 0.0, 0.0, 3000, 3000), costs, "map", np.zeros((0, 2)), 0.1, 0.1)
    start, goal = Pose2D(0.02, 0.02, 0.0), Pose2D(0.02, 149.9, 0.0)
    samples: List[float] = []
    for _ in range(repeats):
        cancelled, asked = Cancellation(), [0.0]

        def cancel(cancelled: Cancellation = cancelled, asked: List[float] = asked) -> None:
            asked[0] = time.perf_counter()
            cancelled.cancel()

        timer = threading.Timer(0.05, cancel)
        timer.start()
        try:
            make(case).plan(costmap, start, goal, 0.0, cancelled)
        except PlanningError:
            samples.append(1e3 * (time.perf_counter() - asked[0]))
        timer.join()
    return metric_of(f"cancel, {case}", samples or [float("nan")], "ms", map="3000 x 3000")


def _lengths(every: int) -> Iterator[Metric]:
    """Yield path lengths over the optimal 8-connected ones on public problems, where the data is at hand."""
    try:
        folder = public_data("movingai")
    except NotMeasurable as reason:
        print(f"path lengths are left out: {reason}", file=sys.stderr)
        return
    for name in MAPS:
        costmap, problems = load_problems(folder, name)
        for case in ("grid path", "any angle", "navfn"):
            planner = make(case)
            ratios = [
                planner.plan(costmap, start, goal, 0.0, Cancellation()).length / optimum
                for start, goal, optimum in problems[::every] if optimum > 0.0]
            yield metric_of(
                f"length over the 8-connected optimum, {name}, {case}", ratios, "", highest=round(max(ratios), 6)
            )


def load_problems(folder: Path, name: str) -> Tuple[CostGrid, List[Tuple[Pose2D, Pose2D, float]]]:
    """Return a map of movingai.com's benchmark as a costmap, and start, goal and optimal length of its problems."""
    lines = (folder / f"{name}.map").read_text(encoding="utf-8").split("map\n", 1)[1].split()
    free = np.array([[letter in ".GS" for letter in line] for line in lines])
    costs = np.where(free, 0, LETHAL).astype(np.uint8)
    costmap = CostGrid(Grid(1.0, 0.0, 0.0, costs.shape[1], costs.shape[0]), costs, "map", np.zeros((0, 2)), 0.5, 0.5)
    rows = [line.split() for line in (folder / f"{name}.map.scen").read_text(encoding="utf-8").splitlines()[1:]]
    return costmap, [
        (Pose2D(int(r[4]) + 0.5, int(r[5]) + 0.5, 0.0), Pose2D(int(r[6]) + 0.5, int(r[7]) + 0.5, 0.0), float(r[8]))
        for r in rows if len(r) > 8]


def _huge() -> Iterator[Metric]:
    """Yield time and peak memory of plans on a building of 500 m x 500 m, in a process of its own."""
    for case in ("grid path", "navfn"):
        told = told_by(f"from benchmark import planning; planning.print_huge({case!r})")
        near, far, megabytes, cells = (float(value) for value in told.split())
        size = f"{HUGE} x {HUGE}"
        yield Metric(f"plan {size}, {case}, to the next room", near, "ms")
        yield Metric(f"plan {size}, {case}, from corner to corner", far, "ms")
        yield Metric(
            f"peak memory, {size}, {case}", megabytes, "MB", parameters={"of which the costs": f"{cells / 1e6:.0f} MB"}
        )


def print_huge(case: str) -> None:
    """Print times (ms) of a near and a far plan, peak memory (MB) and the map's bytes; called in a fresh process."""
    costs = np.zeros((HUGE, HUGE), dtype=np.uint8)
    costs[::200, :] = LETHAL
    costs[:, ::200] = LETHAL
    costs[100::200, ::200] = costs[::200, 100::200] = 0
    for shift in range(-8, 9):  # doors of 17 cells
        costs[100 + shift::200, ::200] = 0
        costs[::200, 100 + shift::200] = 0
    costmap = CostGrid(Grid(0.05, 0.0, 0.0, HUGE, HUGE), costs, "map", np.zeros((0, 2)), 0.1, 0.1)
    planner = make(case)
    times = []
    for goal in (Pose2D(12.0, 4.0, 0.0), Pose2D(493.0, 494.0, 0.0)):
        begin = time.perf_counter()
        _plan(planner, costmap, Pose2D(3.0, 4.0, 0.0), goal)
        times.append(1e3 * (time.perf_counter() - begin))
    with open("/proc/self/status") as status:  # getrusage's peak may be that of who started this process
        peak = next(int(line.split()[1]) for line in status if line.startswith("VmHWM:")) / 1024.0
    print(times[0], times[1], peak, costs.nbytes)
