"""One suite over every planner: what the contract in mbf_relay.planning.planner says, shown on small maps."""

import itertools
import math
import os
import sys
import threading

import numpy as np
import pytest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from planners import CASES, made, plan  # noqa: E402

from mbf_relay import plugins  # noqa: E402
from mbf_relay.costmap.cost_grid import LETHAL, NO_INFORMATION, CostGrid  # noqa: E402
from mbf_relay.geometry import Pose2D, angle_between  # noqa: E402
from mbf_relay.grid import Grid  # noqa: E402
from mbf_relay.outcomes import PlanningError, PlanOutcome  # noqa: E402
from mbf_relay.planning import PLANNERS  # noqa: E402
from mbf_relay.planning.carrot import CarrotPlanner  # noqa: E402
from mbf_relay.planning.planner import Cancellation, Planner, PotentialWatcher  # noqa: E402

RESOLUTION = 0.1


@pytest.fixture(params=sorted(CASES))
def case(request):
    return request.param


@pytest.fixture
def planner(case):
    return made(case)


def test_every_known_planner_is_tested():
    tested = {plugins.find_class(type_name, Planner, PLANNERS) for type_name, _ in CASES.values()}
    known = {plugins.find_class(type_name, Planner, PLANNERS) for type_name in set(PLANNERS) - {"theta_star"}}
    assert {kind for kind in known if not kind.stands_in} - tested == {CarrotPlanner}, (
        "which goes straight, see its own tests"
    )


def test_a_former_name_still_makes_the_planner_and_says_the_present_one():
    with pytest.warns(FutureWarning, match="'theta_star' is called 'any_angle'"):
        former = plugins.create("planner", "theta_star", {}, Planner, PLANNERS)
    assert type(former) is type(made("any angle"))


def snapshot(costs, frame="map"):
    costs = np.ascontiguousarray(costs, dtype=np.uint8)
    grid = Grid(RESOLUTION, -1.0, 2.0, costs.shape[1], costs.shape[0])
    return CostGrid(grid, costs, frame, np.zeros((0, 2)), 0.1, 0.15)


def drawn(text):
    """Return a snapshot from rows of '.', '#' (lethal), '?' (unknown), the top row first."""
    rows = [line.strip() for line in text.strip().splitlines()][::-1]
    values = {".": 0, "#": LETHAL, "?": NO_INFORMATION}
    return snapshot([[values[letter] for letter in row] for row in rows])


def at(costmap, column, row, theta=0.0):
    return Pose2D(*costmap.grid.center_of(column, row), theta)


def outcome_of(planner, *arguments, **options):
    with pytest.raises(PlanningError) as error:
        plan(planner, *arguments, **options)
    assert len(error.value.message) > 20
    return error.value.outcome


def assert_safe(costmap, path):
    """Assert that neither a pose nor a point between two lies in an obstacle or outside the map."""
    shares = np.linspace(0.0, 1.0, 21)[:, None, None]
    starts, ends = path.poses[:-1, :2], path.poses[1:, :2]
    points = (starts + shares * (ends - starts)).reshape(-1, 2)
    is_free = np.zeros(len(points), bool)
    for aside in itertools.product((-1e-9, 1e-9), repeat=2):  # on the border of two cells either is meant
        cells = costmap.grid.cells_at(points + aside)
        inside = costmap.grid.contains_cells(cells)
        columns, rows = cells[inside].T
        costs = costmap.costs[rows, columns]
        is_free[inside] |= (costs < 253) | (costs == NO_INFORMATION)
    assert is_free.all(), points[~is_free]


MAZE = """
    ..........
    .########.
    .#......#.
    .#.####.#.
    .#.#..#.#.
    .#.#.##.#.
    .#.#....#.
    .#.######.
    .#........
    .#########
"""

ROOMS = """
    .....#....
    ..##.#.##.
    ..##...##.
    .....#....
    ###.##....
    ....#...#.
    .##.#.###.
    .##...#...
    ....#.#.#.
    .#..#...#.
"""


@pytest.mark.parametrize("text", [MAZE, ROOMS], ids=["maze", "rooms"])
def test_every_free_cell_is_reached_from_every_other(planner, text):
    costmap = drawn(text)
    rows, columns = np.nonzero(costmap.costs == 0)
    places = [at(costmap, *cell, 1.0) for cell in zip(columns.tolist(), rows.tolist())]
    for goal in places:
        for start in places:
            path = plan(planner, costmap, start, goal)
            assert np.abs(path.poses[0, :2] - start[:2]).max() <= 1e-6  # pytest.approx takes longer than the plan
            assert np.abs(path.poses[-1] - goal).max() <= 1e-6
            cells_passed = costmap.grid.cells_at(path.poses)
            assert (costmap.costs[cells_passed[:, 1], cells_passed[:, 0]] == 0).all()
        assert_safe(costmap, path)


def test_paths_begin_at_the_start_and_end_at_the_goal_exactly(planner):
    costmap = snapshot(np.zeros((30, 30)))
    start, goal = Pose2D(-0.513, 2.221, 0.3), Pose2D(1.287, 4.471, -2.0)
    path = plan(planner, costmap, start, goal)
    assert tuple(path.poses[0, :2]) == start[:2]
    assert tuple(path.poses[-1]) == pytest.approx(goal)
    assert path.frame == costmap.frame
    assert np.isfinite(path.poses).all()
    assert path.length < 1.1 * start.distance_to(goal)


def test_poses_head_along_the_path(planner):
    costmap = drawn(ROOMS)
    path = plan(planner, costmap, at(costmap, 0, 0), at(costmap, 9, 9, 2.5))
    for pose, following in zip(path.poses[:-1], path.poses[1:]):
        ahead = math.atan2(following[1] - pose[1], following[0] - pose[0])
        assert abs(angle_between(pose[2], ahead)) < 1.0


def test_random_maps_hold_no_path_through_an_obstacle(planner):
    rng = np.random.default_rng(2)
    found = 0
    for _ in range(60):
        costs = rng.integers(0, 200, (25, 25))
        costs[rng.random((25, 25)) < 0.25] = LETHAL
        costs[0, 0] = costs[24, 24] = 0
        costmap = snapshot(costs)
        try:
            path = plan(planner, costmap, at(costmap, 0, 0), at(costmap, 24, 24))
        except PlanningError as error:
            assert error.outcome is PlanOutcome.NO_PATH_FOUND
            continue
        found += 1
        assert_safe(costmap, path)
        assert path.cost > 0.0
    assert found > 10


def test_cost_is_symmetric_on_uniform_grids(planner):
    rng = np.random.default_rng(3)
    for _ in range(40):
        costs = np.zeros((30, 30))
        for _ in range(8):
            x, y = rng.integers(2, 24, 2)
            costs[y:y + rng.integers(1, 5), x:x + rng.integers(1, 5)] = LETHAL
        costmap = snapshot(costs)
        here, there = at(costmap, 0, int(rng.integers(30))), at(costmap, 29, int(rng.integers(30)))
        forth, back = plan(planner, costmap, here, there), plan(planner, costmap, there, here)
        assert forth.cost == pytest.approx(back.cost, rel=0.02)
        assert forth.length == pytest.approx(back.length, rel=0.05)


def test_planning_avoids_what_costs_more(planner):
    costs = np.zeros((21, 41))
    costs[8:13, 10:31] = 200
    costmap = snapshot(costs)
    path = plan(planner, costmap, at(costmap, 2, 10), at(costmap, 38, 10))
    cells = costmap.grid.cells_at(path.poses)
    assert (costmap.costs[cells[:, 1], cells[:, 0]] == 0).all()


def test_a_walled_off_goal_has_no_path(planner):
    costmap = drawn("""
        ..........
        ....###...
        ....#.#...
        ....###...
        ..........
    """)
    assert outcome_of(planner, costmap, at(costmap, 0, 0), at(costmap, 5, 2)) is PlanOutcome.NO_PATH_FOUND
    assert outcome_of(planner, costmap, at(costmap, 5, 2), at(costmap, 0, 0)) is PlanOutcome.NO_PATH_FOUND


def test_bad_ends_are_told_apart(planner):
    costmap = drawn("""
        ######
        #....#
        #....#
        ######
    """)
    inside, wall = at(costmap, 2, 1), at(costmap, 0, 1)
    just_outside = Pose2D(costmap.grid.origin_x - RESOLUTION / 2.0, inside.y, 0.0)
    far_outside = Pose2D(costmap.grid.origin_x - costmap.width - RESOLUTION, inside.y, 0.0)
    nowhere = Pose2D(math.nan, 0.0, 0.0)
    assert outcome_of(planner, costmap, wall, inside) is PlanOutcome.BLOCKED_START
    assert outcome_of(planner, costmap, inside, wall) is PlanOutcome.BLOCKED_GOAL
    assert outcome_of(planner, costmap, inside, just_outside) is PlanOutcome.OUT_OF_MAP
    assert outcome_of(planner, costmap, far_outside, inside) is PlanOutcome.OUT_OF_MAP
    assert outcome_of(planner, costmap, just_outside, inside) is PlanOutcome.BLOCKED_START
    assert outcome_of(planner, costmap, nowhere, inside) is PlanOutcome.INVALID_START
    assert outcome_of(planner, costmap, inside, nowhere) is PlanOutcome.INVALID_GOAL



def test_start_equal_to_goal_is_a_path(planner):
    costmap = snapshot(np.zeros((5, 5)))
    path = plan(planner, costmap, at(costmap, 2, 2, 0.5), at(costmap, 2, 2, 1.5))
    assert len(path) == 1 and tuple(path.poses[-1]) == pytest.approx(at(costmap, 2, 2, 1.5))
    assert path.cost == 0.0
    near = Pose2D(at(costmap, 2, 2).x + 0.03, at(costmap, 2, 2).y, 0.0)
    path = plan(planner, costmap, at(costmap, 2, 2), near)
    assert len(path) == 2 and tuple(path.poses[-1]) == pytest.approx(near)


def test_tolerance_finds_the_reachable_point_nearest_to_the_goal(planner):
    costmap = drawn("""
        ..........
        .....####.
        .....#..#.
        .....####.
        ..........
    """)
    goal = at(costmap, 6, 2, 0.7)
    path = plan(planner, costmap, at(costmap, 0, 0), goal, tolerance=0.5)
    assert path.goal.distance_to(goal) == pytest.approx(2 * RESOLUTION)  # nearer ones are walls or walled off
    assert path.goal.theta == pytest.approx(0.7)
    assert_safe(costmap, path)
    assert outcome_of(planner, costmap, at(costmap, 0, 0), goal, tolerance=0.15) is PlanOutcome.NO_PATH_FOUND
    wall = at(costmap, 5, 2)
    for tolerance in (0.15, 3.4e38, 1e308):  # anywhere
        path = plan(planner, costmap, at(costmap, 0, 0), wall, tolerance=tolerance)
        assert path.goal.distance_to(wall) == pytest.approx(RESOLUTION)
    outside = Pose2D(at(costmap, 0, 2).x - RESOLUTION, at(costmap, 0, 2).y, 0.0)
    assert plan(planner, costmap, at(costmap, 9, 0), outside, tolerance=0.15).goal[:2] == pytest.approx(
        at(costmap, 0, 2)[:2]
    )


def test_the_planner_has_a_tolerance_of_its_own(case):
    costmap = drawn("....#")
    assert plan(made(case, default_tolerance=0.15), costmap, at(costmap, 0, 0), at(costmap, 4, 0)).goal[
        0
    ] == pytest.approx(at(costmap, 3, 0).x)


def test_tolerance_agrees_with_a_search_of_all_cells(planner):
    rng, tolerance = np.random.default_rng(8), 0.4
    for _ in range(40):
        costs = np.where(rng.random((20, 20)) < 0.45, LETHAL, 0)
        costs[0, 0] = 0
        costmap = snapshot(costs)
        goal = Pose2D(*rng.uniform((-1.0, 2.0), (1.0, 4.0)), 0.0)
        steps = {(0, 0): 0}
        waiting = [(0, 0)]
        for x, y in waiting:
            for cell in ((x + 1, y), (x - 1, y), (x, y + 1), (x, y - 1)):
                if costmap.grid.contains_cell(*cell) and costs[cell[1], cell[0]] == 0 and cell not in steps:
                    steps[cell] = steps[(x, y)] + 1
                    waiting.append(cell)
        near = {cell: at(costmap, *cell).distance_to(goal) for cell in steps}
        near = {cell: distance for cell, distance in near.items() if distance <= tolerance}
        if costmap.grid.cell_at(goal.x, goal.y) in steps:
            assert plan(planner, costmap, at(costmap, 0, 0), goal, tolerance=tolerance).goal == pytest.approx(goal)
        elif not near:
            assert outcome_of(planner, costmap, at(costmap, 0, 0), goal, tolerance=tolerance) in (
                PlanOutcome.NO_PATH_FOUND, PlanOutcome.BLOCKED_GOAL)
        else:
            first = min(steps[cell] for cell in near)
            best = min(near[cell] for cell in near if steps[cell] - first <= 2.0 * math.pi * tolerance / RESOLUTION)
            path = plan(planner, costmap, at(costmap, 0, 0), goal, tolerance=tolerance)
            assert path.goal.distance_to(goal) == pytest.approx(best, abs=1e-9)


@pytest.mark.parametrize("allowed", [True, False])
def test_unknown_cells_are_crossed_only_where_allowed(case, allowed):
    costmap = drawn("""
        ..?..
        ..?..
        ..?..
    """)
    planner = made(case, allow_unknown=allowed)
    if allowed:
        assert len(plan(planner, costmap, at(costmap, 0, 1), at(costmap, 4, 1))) > 1
    else:
        assert outcome_of(planner, costmap, at(costmap, 0, 1), at(costmap, 4, 1)) is PlanOutcome.NO_PATH_FOUND
        assert outcome_of(planner, costmap, at(costmap, 0, 1), at(costmap, 2, 1)) is PlanOutcome.BLOCKED_GOAL


@pytest.mark.parametrize("blocked", [0.15, 0.35])
def test_replans_cost_what_plans_from_scratch_cost(case, blocked):
    rng = np.random.default_rng(6)
    planner = made(case)
    costs = rng.integers(0, 150, (50, 50)).astype(np.uint8)
    costs[rng.random((50, 50)) < blocked] = LETHAL
    # string pulling starts from the path the search happened to find, of several that cost the same
    tolerance = 5e-3 if case == "any angle" else 1e-5
    planned = 0
    for step in range(40):
        x, y = rng.integers(0, 44, 2)
        costs[y:y + 3, x:x + 3] = rng.choice([LETHAL, 20])
        costs[45, 45] = costs[step, 3] = 0
        costmap = snapshot(costs.copy())
        start, goal = at(costmap, 3, step), at(costmap, 45, 45)
        try:
            expected = plan(made(case), costmap, start, goal).cost
        except PlanningError as error:
            assert outcome_of(planner, costmap, start, goal) is error.outcome
            continue
        assert plan(planner, costmap, start, goal).cost == pytest.approx(expected, rel=tolerance)
        planned += 1
    assert planned > 20 and (planned < 40) == (blocked > 0.2), "at times there is no way where much is blocked"


def test_a_running_plan_can_be_cancelled_by_another_thread(planner):
    costs = np.zeros((2000, 2000), dtype=np.uint8)
    costs[1::4, :-1] = LETHAL
    costs[3::4, 1:] = LETHAL
    costmap = snapshot(costs)
    cancelled = Cancellation()
    timer = threading.Timer(0.005, cancelled.cancel)
    timer.start()
    assert outcome_of(
        planner, costmap, at(costmap, 0, 0), at(costmap, 0, 1998), cancelled=cancelled) is PlanOutcome.CANCELED
    timer.join()


class Watcher(PotentialWatcher):
    """Remembers what it was shown."""

    def __init__(self, watching):
        self.watching, self.seen = watching, []

    def is_watching(self):
        return self.watching

    def take(self, costmap, potential, start):
        self.seen.append((costmap, potential.copy(), start))


def test_a_watcher_sees_the_potential_and_the_path_is_the_same(case):
    costmap = drawn(ROOMS)
    start, goal = at(costmap, 0, 0), at(costmap, 9, 9)
    unwatched = plan(made(case), costmap, start, goal)
    for watching in (True, False):
        planner = made(case)
        planner.potential_watcher = Watcher(watching)
        path = plan(planner, costmap, start, goal)
        assert path.cost == pytest.approx(unwatched.cost, rel=1e-5)
        assert len(planner.potential_watcher.seen) == watching
    planner.potential_watcher = Watcher(True)
    plan(planner, costmap, start, goal)
    (_, potential, _), = planner.potential_watcher.seen
    assert potential.shape == costmap.costs.shape
    assert (potential[costmap.costs == LETHAL] == 0.0).all() and potential[0, 0] > potential[9, 8] > 0.0


def test_a_goal_in_the_robot_s_own_cell_is_planned_to_whatever_map_there_was_before(case):
    """It was shown the potential of the plan before, which did not fit a map that had grown since."""
    planner = made(case)
    planner.potential_watcher = Watcher(True)
    small, grown = drawn(ROOMS), snapshot(np.zeros((30, 30), dtype=np.uint8))
    plan(planner, small, at(small, 0, 0), at(small, 9, 9))
    plan(planner, grown, at(grown, 29, 29), at(grown, 29, 29))
    for costmap, potential, _ in planner.potential_watcher.seen:
        assert potential.shape == costmap.costs.shape
