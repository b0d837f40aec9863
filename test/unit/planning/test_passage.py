"""Paths the robot fits along: where its footprint would touch, when it is led round, and when the first path stands."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plain_footprint import contacts

from mbf_relay import plugins
from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, NO_INFORMATION, CostGrid
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning import PLANNERS, passage
from mbf_relay.planning.passage import driven, lead_round, touching_cells
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Cancellation, Planner

RESOLUTION = 0.05
LONG = np.array([[-0.3, -0.16], [-0.3, 0.16], [0.1, 0.16], [0.1, -0.16]])
"""A robot whose axle lies near its end: 0.32 m wide, though no circle round its base is larger than 0.1 m."""


def snapshot(lethal, unknown=None, inscribed=0.1):
    """Return a snapshot with lethal cells and, round them, those the robot's centre is kept out of."""
    costs = np.zeros(lethal.shape, dtype=np.uint8)
    if unknown is not None:
        costs[unknown] = NO_INFORMATION
    rows, columns = np.nonzero(lethal)
    y, x = np.mgrid[:lethal.shape[0], :lethal.shape[1]]
    for row, column in zip(rows, columns):
        costs[np.hypot(x - column, y - row) * RESOLUTION <= inscribed] = INSCRIBED
    costs[lethal] = LETHAL
    grid = Grid(RESOLUTION, -1.0, 2.0, lethal.shape[1], lethal.shape[0])
    return CostGrid(grid, costs, "map", LONG, inscribed, 0.34)


def wall(gaps, width=60, height=100, column=30):
    """Return a snapshot with a wall across it, open where `gaps` say: (first row, rows) each."""
    lethal = np.zeros((height, width), dtype=bool)
    lethal[:, column] = True
    for first, rows in gaps:
        lethal[first:first + rows, column] = False
    return snapshot(lethal)


class Scripted:
    """Answers with what it was given: paths, or errors to raise; the last one again and again."""

    def __init__(self, answers):
        self.answers, self.snapshots = list(answers), []

    def __call__(self, costmap):
        self.snapshots.append(costmap)
        answer = self.answers.pop(0) if len(self.answers) > 1 else self.answers[0]
        if isinstance(answer, PlanningError):
            raise answer
        return answer


class Counted:
    """A grid planner's search on one snapshot, and how often it was asked."""

    def __init__(self, type_name="navfn/NavfnROS"):
        self.planner, self.calls = plugins.create("planner", type_name, {}, Planner, PLANNERS), 0
        self.once = self.planner._plan_on
        self.planner._plan_on = self._plan_on

    def _plan_on(self, *arguments):
        self.calls += 1
        return self.once(*arguments)

    def first(self, costmap, start, goal):
        return self.once(costmap, start, goal, 0.0, Cancellation())

    def plan(self, costmap, start, goal):
        return self.planner.plan(costmap, start, goal, 0.0, Cancellation())


made = Counted


def at(costmap, column, row):
    return Pose2D(*costmap.grid.center_of(column, row), 0.0)


def straight(costmap, *corners):
    """Return a path of points a quarter of a cell apart through corners (column, row)."""
    points = []
    for (x0, y0), (x1, y1) in zip(corners[:-1], corners[1:]):
        count = 4 * max(abs(x1 - x0), abs(y1 - y0)) + 1
        points.append(np.column_stack((np.linspace(x0, x1, count), np.linspace(y0, y1, count))))
    places = costmap.grid.centers_of(np.concatenate(points))
    return Path(np.column_stack((places, np.zeros(len(places)))), "map")


def narrow(costmap, path):
    return touching_cells(FootprintChecker(costmap, unknown_touches=False), path)


@settings(max_examples=60)
@given(st.integers(0, 2 ** 32 - 1))
def test_cells_are_narrow_where_the_footprint_touches_on_the_way(seed):
    rng = np.random.default_rng(seed)
    costs = np.zeros((40, 60), dtype=np.uint8)
    costs[rng.random(costs.shape) < 0.02] = LETHAL
    costs[rng.random(costs.shape) < 0.1] = NO_INFORMATION
    costmap = CostGrid(Grid(RESOLUTION, -1.0, 2.0, 60, 40), costs, "map", LONG, 0.1, 0.34)
    places = np.array([-0.9, 3.0]) + np.cumsum(rng.normal((0.04, 0.0), (0.0, 0.01), (60, 2)), axis=0)
    path = Path(np.column_stack((places, np.zeros(60))), "map")
    seen = CostGrid(costmap.grid, np.where(costs == LETHAL, costs, 0), "map", LONG, 0.1, 0.34)
    expected, last = set(), None
    poses, arcs = driven(places, 0.16)
    for n, pose in enumerate(poses):
        near_ends = min(np.hypot(*(pose[:2] - places[0])), np.hypot(*(pose[:2] - places[-1]))) <= 0.34
        if not near_ends and contacts(seen, Pose2D(*pose), headings=512, outside=0):
            first = n if last is None or arcs[n] - arcs[last] > 0.4 else last
            expected.update(costmap.grid.cell_at(*between[:2]) for between in poses[first:n + 1])
            last = n
    found = {tuple(cell) for cell in narrow(costmap, path).tolist()}
    assert found <= {(x + dx, y + dy) for x, y in expected for dx in (-1, 0, 1) for dy in (-1, 0, 1)}
    assert len(found ^ expected) <= 2, "a point on the edge of a cell may round either way"


def test_steps_from_cell_to_cell_turn_no_robot():
    stairs = np.column_stack((0.05 * np.arange(40), 0.05 * np.repeat(np.arange(20), 2)))
    headings = driven(stairs, 0.2)[0][:, 2]
    assert np.abs(headings - math.atan2(1.0, 2.0)).max() < 0.12


def test_a_wide_way_is_taken_where_the_short_one_is_too_narrow():
    costmap = wall([(48, 5), (70, 12)])  # 0.25 m ahead, 0.6 m a metre aside
    planner = made()
    start, goal = at(costmap, 5, 50), at(costmap, 55, 50)
    assert len(narrow(costmap, planner.first(costmap, start, goal))) > 0
    path = planner.plan(costmap, start, goal)
    assert len(narrow(costmap, path)) == 0
    assert path.poses[:, 1].max() > costmap.grid.center_of(0, 70)[1]
    assert tuple(path.poses[0, :2]) == tuple(start[:2]) and tuple(path.poses[-1, :2]) == tuple(goal[:2])


def test_a_robot_that_is_led_round_waits_for_no_distances_of_the_whole_map(monkeypatch):
    costmap = wall([(48, 5), (70, 12)])
    monkeypatch.delattr(passage, "is_too_narrow")
    path = made().plan(costmap, at(costmap, 5, 50), at(costmap, 55, 50))
    assert len(narrow(costmap, path)) == 0


def test_a_gap_that_is_wide_enough_is_passed():
    costmap = wall([(46, 10), (70, 12)])
    planner = made()
    path = planner.plan(costmap, at(costmap, 5, 50), at(costmap, 55, 50))
    assert planner.calls == 1 and path.length < 2.7


@pytest.mark.parametrize("gaps, height", [([(48, 5)], 100), ([(48, 5), (180, 12)], 200)], ids=["no other", "too far"])
def test_the_narrow_way_stands_where_there_is_no_other_or_a_far_one(gaps, height):
    costmap = wall(gaps, height=height)
    start, goal = at(costmap, 5, 50), at(costmap, 55, 50)
    first = made().first(costmap, start, goal)
    path = made().plan(costmap, start, goal)
    assert (path.poses == first.poses).all() and path.cost == first.cost


def test_a_robot_as_wide_as_its_inscribed_circle_is_not_looked_at():
    lethal = np.zeros((100, 60), dtype=bool)
    lethal[:48, 30] = lethal[53:70, 30] = True
    square = np.array([[-0.1, -0.1], [-0.1, 0.1], [0.1, 0.1], [0.1, -0.1]])
    for outline in (square, np.zeros((0, 2))):
        round_robot = CostGrid(snapshot(lethal).grid, snapshot(lethal).costs, "map", outline, 0.1, 0.15)
        planner = made()
        planner.plan(round_robot, at(round_robot, 5, 50), at(round_robot, 55, 50))
        assert planner.calls == 1


def corridor(columns):
    """Return a snapshot with a narrow corridor along row 50 over `columns`, between two thin walls."""
    lethal = np.zeros((100, 100), dtype=bool)
    for row in (47, 53):
        lethal[row, columns[0]:columns[1]] = True
    return snapshot(lethal)


@pytest.mark.parametrize("column", [40, 50, 60])
def test_a_start_inside_a_narrow_corridor_leads_out_of_it(column):
    costmap = corridor((40, 61))
    start, goal = at(costmap, column, 50), at(costmap, 90, 50)
    path = made().plan(costmap, start, goal)
    assert tuple(path.poses[0, :2]) == tuple(start[:2]) and tuple(path.poses[-1, :2]) == tuple(goal[:2])
    # closing the corridor ahead walls the robot in, so it goes on; only beside its walls it is led away
    left = {(int(x), int(y)) for x, y in narrow(costmap, path)}
    assert all(40 - 8 <= x <= 60 + 8 and 44 <= y <= 56 for x, y in left)


def test_a_goal_inside_a_narrow_corridor_is_reached():
    costmap = corridor((40, 61))
    start, goal = at(costmap, 5, 50), at(costmap, 50, 50)
    path = made().plan(costmap, start, goal)
    assert tuple(path.poses[-1, :2]) == tuple(goal[:2])


def test_what_lies_within_reach_of_start_and_goal_is_left_out():
    costmap = wall([(48, 5)])
    near = straight(costmap, (28, 50), (32, 50))  # 0.1 m before and behind the wall
    assert len(narrow(costmap, near)) == 0
    assert len(narrow(costmap, straight(costmap, (20, 50), (40, 50)))) > 0


def test_unknown_cells_and_inscribed_ones_make_nothing_narrow():
    lethal = np.zeros((30, 60), dtype=bool)
    unknown = np.ones((30, 60), dtype=bool)
    unknown[15, :] = False
    costmap = snapshot(lethal, unknown)
    path = straight(costmap, (3, 15), (57, 15))
    assert len(narrow(costmap, path)) == 0
    costmap.costs[14, :] = INSCRIBED
    assert len(narrow(costmap, path)) == 0
    costmap.costs[14, 30] = LETHAL
    assert len(narrow(costmap, path)) > 0


def test_a_doorway_that_nobody_has_seen_and_is_too_narrow_is_no_way():
    lethal, unknown = np.zeros((40, 100), dtype=bool), np.zeros((40, 100), dtype=bool)
    lethal[:, 45:55], lethal[18:23, 45:55], unknown[18:23, 45:55] = True, False, True
    costmap = snapshot(lethal, unknown & ~lethal)
    start, goal = at(costmap, 10, 20), at(costmap, 90, 20)
    path = made().first(costmap, start, goal)
    cells = narrow(costmap, path)
    checker = passage.checker_on(costmap)
    assert len(cells) > 0 and not passage.is_too_narrow(checker, cells)
    assert len(made().plan(costmap, start, goal)) == len(path)


@pytest.mark.parametrize("corners", [((0, 0), (59, 0)), ((59, 0), (59, 29)), ((59, 29), (0, 29)), ((0, 29), (0, 0))])
def test_the_maps_edge_is_no_obstacle_and_one_on_it_is(corners):
    free = snapshot(np.zeros((30, 60), dtype=bool))
    path = straight(free, *corners)
    planner = Scripted([path])
    assert lead_round(planner, free) is path and len(planner.snapshots) == 1
    lethal = np.zeros((30, 60), dtype=bool)
    column, row = (corners[0][0] + corners[1][0]) // 2, (corners[0][1] + corners[1][1]) // 2
    lethal[row, column] = True
    assert (column, row) in {tuple(cell) for cell in narrow(snapshot(lethal), path).tolist()}


def test_closed_cells_are_those_too_narrow_and_their_neighbours_and_the_picture_given_stays():
    costmap = wall([(48, 5)])
    before = costmap.costs.copy()
    first = straight(costmap, (5, 50), (55, 50))
    planner = Scripted([first, straight(costmap, (5, 50), (5, 90))])
    lead_round(planner, costmap)
    asked_again = planner.snapshots[1]
    closed = (asked_again.costs != before) & (asked_again.costs == INSCRIBED)
    expected = np.zeros_like(closed)
    for x, y in narrow(costmap, first):
        expected[max(y - 1, 0):y + 2, max(x - 1, 0):x + 2] = True
    assert (closed == (expected & (before < INSCRIBED))).all()
    assert (costmap.costs == before).all()
    assert asked_again.revision == 0 and asked_again.changed_since(costmap.revision) is None


def test_closings_add_up_and_end_after_so_many_tries():
    costmap = wall([(row, 5) for row in range(3, 95, 8)])
    ways = [straight(costmap, (20, row), (40, row)) for row in range(5, 95, 8)]
    planner = Scripted(ways)
    assert lead_round(planner, costmap) is ways[0]
    assert len(planner.snapshots) == 1 + passage.TRIES
    counts = [(seen.costs == INSCRIBED).sum() for seen in planner.snapshots]
    assert counts == sorted(counts) and counts[-1] > counts[1]


def test_a_cancelled_second_look_is_cancelled_and_another_failure_leaves_the_first_path():
    costmap = wall([(48, 5)])
    first = straight(costmap, (5, 50), (55, 50))
    for outcome in PlanOutcome:
        if outcome in (PlanOutcome.SUCCESS, PlanOutcome.CANCELED):
            continue
        planner = Scripted([first, PlanningError(outcome, "none")])
        assert lead_round(planner, costmap) is first
    planner = Scripted([first, PlanningError(PlanOutcome.CANCELED, "called off")])
    with pytest.raises(PlanningError, match="called off"):
        lead_round(planner, costmap)


@settings(max_examples=40)
@given(st.integers(0, 2 ** 32 - 1))
def test_the_path_has_room_or_is_the_first_and_never_a_much_longer_one(seed):
    rng = np.random.default_rng(seed)
    lethal = np.zeros((60, 60), dtype=bool)
    for column in (20, 40):
        lethal[:, column] = True
        for first in rng.integers(0, 55, 3):
            lethal[first:first + rng.integers(5, 12), column] = False
    costmap = snapshot(lethal)
    start, goal = at(costmap, 5, int(rng.integers(3, 57))), at(costmap, 55, int(rng.integers(3, 57)))
    first = made("global_planner/GlobalPlanner").first(costmap, start, goal)
    path = made("global_planner/GlobalPlanner").plan(costmap, start, goal)
    assert path.length <= passage.DETOUR_FACTOR * first.length + passage.DETOUR_WIDTHS * costmap.width
    if len(narrow(costmap, first)) == 0 or len(narrow(costmap, path)):
        assert path.poses.shape == first.poses.shape and (path.poses == first.poses).all()
    assert tuple(path.poses[0, :2]) == tuple(start[:2]) and tuple(path.poses[-1, :2]) == tuple(goal[:2])
