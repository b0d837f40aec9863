"""Gaps that turned the robot away: whether it comes back to them, goes round them, or takes them for want of others."""

import numpy as np
import pytest
from scripted import FORWARD, GOAL, STUCK, PaperCostmap, bowed_path

from mbf_relay import plugins
from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, CostGrid
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.grid import Grid
from mbf_relay.navigation.goals import FollowFeedback, FramedPose
from mbf_relay.navigation.refused_places import (
    DOUBLINGS,
    FORGOTTEN,
    HALF_LIFE,
    MOST_PLANS,
    TOLL,
    RefusedPlaces,
    Toll,
    plan_round,
    refusing_place,
)
from mbf_relay.navigation.ways import STOOD_FOR, Ways
from mbf_relay.outcomes import ControlOutcome, PlanningError, PlanOutcome
from mbf_relay.planning import PLANNERS
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Cancellation, Planner

WIDTH = 0.2
SQUARE = np.array([[-0.1, -0.1], [-0.1, 0.1], [0.1, 0.1], [0.1, -0.1]])
START, GOAL_POSE = Pose2D(0.5, 1.5, 0.0), Pose2D(2.5, 1.5, 0.0)
NEAR_GAP, FAR_GAP = (1.52, 1.5), (1.52, 2.4)


def wall_with_gaps(*gaps):
    """A snapshot of 3 m by 3 m with a wall across it at 1.5 m, open 0.4 m round each gap."""
    grid = Grid(0.05, 0.0, 0.0, 60, 60)
    costs = np.zeros(grid.shape, dtype=np.uint8)
    ys = (np.arange(60) + 0.5) * 0.05
    costs[:, 30] = LETHAL
    for _, y in gaps:
        costs[np.abs(ys - y) < 0.2, 30] = 0
        costs[np.abs(np.abs(ys - y) - 0.2) < 0.06, 29:32] = INSCRIBED
        costs[np.abs(ys - y) < 0.13, 28:33] = 0
    return CostGrid(grid, costs, "map", SQUARE, 0.1, 0.142)


def plan(costmap, tolls=(), start=START):
    navfn = plugins.create("navfn", "navfn/NavfnROS", {}, Planner, PLANNERS)
    return plan_round(
        tolls, costmap, start, GOAL_POSE, lambda seen: navfn.plan(seen, start, GOAL_POSE, 0.0, Cancellation()))


def passes(path, gap):
    return bool((np.hypot(*(path.poses[:, :2] - gap).T) < 0.15).any())


def test_a_gap_that_was_refused_is_gone_round_where_that_is_worth_it():
    costmap = wall_with_gaps(NEAR_GAP, FAR_GAP)
    assert passes(plan(costmap), NEAR_GAP)
    way_round = plan(costmap, [Toll(NEAR_GAP, 1.0)])
    assert passes(way_round, FAR_GAP) and not passes(way_round, NEAR_GAP)
    longer = way_round.length - plan(costmap).length
    assert passes(plan(costmap, [Toll(NEAR_GAP, 0.9 * longer)]), NEAR_GAP)


def test_the_only_gap_is_taken_however_often_it_was_refused():
    assert passes(plan(wall_with_gaps(NEAR_GAP), [Toll(NEAR_GAP, 99.0)]), NEAR_GAP)


def test_of_gaps_that_all_refused_the_robot_it_takes_the_one_worth_least():
    """All were closed at once, which left no path, and so the robot stood before the nearest till its time was up."""
    costmap = wall_with_gaps(NEAR_GAP, FAR_GAP)
    far = plan(costmap, [Toll(NEAR_GAP, 9.0)]).poses[:, :2]
    in_far = tuple(far[np.hypot(*(far - FAR_GAP).T).argmin()])
    for near_toll, far_toll, taken in (9.0, 2.0, FAR_GAP), (2.0, 9.0, NEAR_GAP):
        tolls = [Toll(NEAR_GAP, near_toll), Toll(in_far, far_toll), Toll(FAR_GAP, far_toll)]
        assert passes(plan(costmap, tolls), taken)


def test_a_robot_right_before_the_gap_that_refused_it_is_not_walled_in_by_that():
    """Closed as far as the robot is wide, the gap reached to where it stood, from where there was no path then."""
    start, seen = Pose2D(1.4, 1.5, 0.0), []

    def straight(costmap):
        seen.append(costmap)
        return Path(np.array([start, [*NEAR_GAP, 0.0], GOAL_POSE]), "map")

    plan_round([Toll(NEAR_GAP, 9.0)], wall_with_gaps(NEAR_GAP, FAR_GAP), start, GOAL_POSE, straight)
    at_start, in_gap = seen[1].blocks(np.array([start, [*NEAR_GAP, 0.0]])).tolist()
    assert in_gap and not at_start


def test_a_place_the_robot_stands_at_or_goes_to_costs_nothing():
    costmap = wall_with_gaps(NEAR_GAP, FAR_GAP)
    tolls = [Toll(START[:2], 9.0), Toll(GOAL_POSE[:2], 9.0)]
    assert np.array_equal(plan(costmap, tolls).poses, plan(costmap).poses)


def test_a_plan_past_no_refused_place_is_asked_for_once():
    calls = []

    def straight(seen):
        calls.append(seen)
        return Path(np.array([START, GOAL_POSE]), "map")

    costmap = wall_with_gaps(NEAR_GAP, FAR_GAP)
    plan_round([Toll(FAR_GAP, 9.0)], costmap, START, GOAL_POSE, straight)
    assert calls == [costmap]


def test_where_every_way_was_refused_only_so_many_are_looked_at():
    calls, places = [], [(1.5, 0.25 * k) for k in range(2 * MOST_PLANS)]

    def through_the_next(seen):
        calls.append(seen)
        return Path(np.array([START, [*places[len(calls) - 1], 0.0], GOAL_POSE]), "map")

    costmap = wall_with_gaps(NEAR_GAP, FAR_GAP)
    tolls = [Toll(place, 9.0 - k) for k, place in enumerate(places)]
    path = plan_round(tolls, costmap, START, GOAL_POSE, through_the_next)
    assert len(calls) == MOST_PLANS and tuple(path.poses[1, :2]) == places[MOST_PLANS - 1]


def test_a_plan_called_off_on_the_way_round_is_called_off():
    answers = [Path(np.array([START, [*NEAR_GAP, 0.0], GOAL_POSE]), "map"), PlanningError(PlanOutcome.CANCELED, "stop")]

    def search(_seen):
        answer = answers.pop(0)
        if isinstance(answer, PlanningError):
            raise answer
        return answer

    with pytest.raises(PlanningError, match="stop"):
        plan_round([Toll(NEAR_GAP, 9.0)], wall_with_gaps(NEAR_GAP), START, GOAL_POSE, search)


def test_what_is_closed_for_one_plan_is_open_for_the_next():
    costmap = wall_with_gaps(NEAR_GAP, FAR_GAP)
    before = costmap.costs.copy()
    plan(costmap, [Toll(NEAR_GAP, 9.0)])
    assert np.array_equal(costmap.costs, before)


def test_a_toll_rises_with_each_refusal_and_fades():
    places = RefusedPlaces()
    tolls = []
    for _ in range(DOUBLINGS + 2):
        places.refuse(0.0, (1.0, 1.0), WIDTH)
        tolls.append(places.tolls(0.0, WIDTH)[0].detour)
    assert tolls[:DOUBLINGS] == pytest.approx([TOLL * WIDTH * 2.0 ** n for n in range(DOUBLINGS)])
    assert tolls[-1] == tolls[DOUBLINGS - 1]
    assert places.tolls(HALF_LIFE, WIDTH)[0].detour == pytest.approx(0.5 * tolls[-1])
    assert places.tolls(20.0 * HALF_LIFE, WIDTH) == ()
    assert FORGOTTEN < TOLL


def test_a_place_refused_before_the_clock_was_set_back_is_worth_no_way_round():
    """Its toll rose with each second that the clock was set back by, to any way round, and beyond all numbers."""
    places = RefusedPlaces()
    places.refuse(50000.0, (1.0, 1.0), WIDTH)
    assert places.tolls(49000.0, WIDTH) == places.tolls(0.0, WIDTH) == ()


def test_one_gap_refused_at_two_of_its_cells_is_one_place():
    places = RefusedPlaces()
    places.refuse(0.0, (1.0, 1.0), WIDTH)
    places.refuse(1.0, (1.0, 1.15), WIDTH)
    places.refuse(1.0, (1.0, 2.0), WIDTH)
    assert [toll.place for toll in places.tolls(1.0, WIDTH)] == [(1.0, 1.15), (1.0, 2.0)]


def test_the_place_told_of_is_the_first_that_does_not_fit():
    costmap = wall_with_gaps(NEAR_GAP, FAR_GAP)
    xs = np.linspace(0.5, 2.5, 41)
    through_the_wall = np.column_stack((xs, np.full(41, 0.5), np.zeros(41)))
    x, y = refusing_place(costmap, through_the_wall)
    assert 1.3 < x < 1.52 and abs(y - 0.5) < 0.05
    assert refusing_place(costmap, plan(costmap).poses) is None
    assert refusing_place(costmap, through_the_wall[:1]) is None
    assert refusing_place(costmap, through_the_wall + (50.0, 0.0, 0.0)) is None


def test_a_robot_that_stands_before_a_gap_goes_another_way_before_anybody_calls_it_stuck(make_bench):
    ways = {side: bowed_path(side * 0.4) for side in (-1, 1)}
    bench = make_bench(planner_frequency=5.0, controller_patience=15.0, oscillation_timeout=10.0)
    script, gap = bench.script, ways[1].poses[1, :2]

    def shorter_where_open(_start, _goal):
        seen = script.planned_on[-1]
        column, row = seen.grid.cell_at(*gap)
        return ways[-1 if seen.costs[row, column] >= INSCRIBED else 1]

    def only_the_other_side(_state):
        if script.paths[-1][0] is ways[1]:
            raise STUCK
        return FORWARD

    script.plan, script.velocity = shorter_where_open, only_the_other_side
    bench.navigator.move_base(GOAL)
    began = bench.now
    bench.run(lambda: script.paths and script.paths[-1][0] is ways[-1], 9.0)
    assert bench.now - began < 4.0 * STOOD_FOR and "R1" not in script.calls


@pytest.mark.parametrize("trouble, is_refused", [("obstacle", True), ("silent lidar", False), ("lost pose", False)])
def test_a_way_is_not_gone_round_because_the_robot_saw_nothing_on_it_for_a_while(make_bench, trouble, is_refused):
    bench = make_bench(planner_frequency=5.0, controller_patience=15.0, tf_timeout=15.0)
    bench.navigator.move_base(GOAL)
    bench.step()
    if trouble == "obstacle":
        bench.script.velocity = STUCK
    elif trouble == "silent lidar":
        bench.costmaps["local"].stale = "no scan for 0.50 s"
    else:
        bench.robot.lost = "no transform"
    for _ in range(int(20.0 * STOOD_FOR)):
        bench.step()
    bench.script.velocity, bench.costmaps["local"].stale, bench.robot.lost = FORWARD, None, None
    bench.step(1.0)
    assert any((seen.costs == INSCRIBED).any() for seen in bench.script.planned_on) is is_refused


@pytest.mark.parametrize("wall, refused_at", [(None, (2.1, 1.0)), (2.5, (2.5, 1.0))])
def test_cycles_without_a_velocity_refuse_the_place_ahead_once_they_sum_up_and_not_before(bench, wall, refused_at):
    costmap = bench.costmaps["global"]
    if wall is not None:
        costmap.costs[:, costmap.grid.cell_at(wall + 0.01, 0.0)[0]] = LETHAL
    ways, pose = Ways(bench.robot, costmap), FramedPose(Pose2D(2.0, 1.0, 0.0), "map")
    frequency, path = 10.0, Path(bowed_path(0.0).poses + (2.0, 1.0, 0.0), "map")

    def fail(times):
        for _ in range(times):
            ways.watch(2.0, FollowFeedback(ControlOutcome.NO_VALID_CMD, "", pose, refused=True), path, frequency)
            ways.watch(2.0, FollowFeedback(ControlOutcome.SUCCESS, "", pose), path, frequency)

    fail(int(STOOD_FOR * frequency) - 1)
    assert ways.tolls(2.0) == ()
    for times, detour in ((1, TOLL * 0.2), (int(STOOD_FOR * frequency) - 1, TOLL * 0.2), (1, 2.0 * TOLL * 0.2)):
        fail(times)
        (toll,) = ways.tolls(2.0)
        assert toll.place == pytest.approx(refused_at, abs=0.051) and toll.detour == pytest.approx(detour)


def test_a_robot_whose_frames_are_lost_remembers_nothing_and_goes_on(bench):
    ways = Ways(bench.robot, bench.costmaps["global"])
    bench.robot.lost = "no transform"
    pose = FramedPose(Pose2D(0.0, 0.0, 0.0), "map")
    refused = FollowFeedback(ControlOutcome.NO_VALID_CMD, "", pose, refused=True)
    for cycle in range(100):
        ways.watch(0.1 * cycle, refused, bowed_path(0.4), 10.0)
    assert ways.tolls(10.0) == () and not ways.is_blocked(bowed_path(0.4), pose)


@pytest.mark.parametrize("frame, offset", [("map", 0.0), ("odom", 1.0)])
def test_an_obstacle_behind_the_robot_blocks_no_path_whatever_frame_the_costmap_has(bench, monkeypatch, frame, offset):
    """A robot drove on to a person before it, or turned back for one behind, whose costmap was not in global_frame."""
    def transform(target, source):
        return Pose2D(offset if target == "odom" else 0.0, 0.0, 0.0) if target != source else IDENTITY

    monkeypatch.setattr(bench.robot, "transform", transform)
    costmap = PaperCostmap(frame)
    ways, path = Ways(bench.robot, costmap), Path(np.linspace((0.0, 0.0, 0.0), (3.0, 0.0, 0.0), 61), "map")
    costmap.costs[:, costmap.grid.cell_at(1.0 + offset, 0.0)[0]] = LETHAL
    assert ways.is_blocked(path, FramedPose(Pose2D(0.2, 0.0, 0.0), "map"))
    assert not ways.is_blocked(path, FramedPose(Pose2D(1.5, 0.0, 0.0), "map"))
