"""The check and search services' answers against brute force over random costmaps."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, NO_INFORMATION, CostGrid
from mbf_relay.costmap.inspection import (
    POINT,
    Multipliers,
    PoseState,
    check_path,
    check_point,
    check_poses,
    find_valid_pose,
)
from mbf_relay.geometry import Pose2D, angle_between
from mbf_relay.grid import Grid

BURGER = np.array([[-0.105, -0.105], [-0.105, 0.105], [0.041, 0.105], [0.041, -0.105]])


def random_costmap(seed, free=0.6):
    rng = np.random.default_rng(seed)
    grid = Grid(0.05, -1.0, -0.5, 40, 30)
    kinds = rng.choice(5, size=grid.shape, p=[free, 0.1, (0.9 - free) / 3, (0.9 - free) / 3, (0.9 - free) / 3])
    table = np.array([0, 0, INSCRIBED, LETHAL, NO_INFORMATION], dtype=np.uint8)
    costs = table[kinds]
    costs[kinds == 1] = rng.integers(1, 253, size=int((kinds == 1).sum()))
    return CostGrid(grid, costs, "map", BURGER, 0.04, 0.15)


def covered_cells(grid, outline, pose):
    """Cells under an outline, drawn line by line as costmap_2d does, and between them in each row."""
    corners = grid.cells_at(pose.transform_points(outline) if len(outline) else np.array([pose[:2]])).tolist()
    drawn = {}
    for (x0, y0), (x1, y1) in zip(corners, corners[1:] + corners[:1]):
        dx, dy = abs(x1 - x0), abs(y1 - y0)
        sx, sy = (1 if x1 >= x0 else -1), (1 if y1 >= y0 else -1)
        longer, shorter = max(dx, dy), min(dx, dy)
        for step in range(longer + 1):
            minor = (longer // 2 + step * shorter) // longer if longer else 0
            x, y = (x0 + sx * step, y0 + sy * minor) if dx >= dy else (x0 + sx * minor, y0 + sy * step)
            drawn.setdefault(y, []).append(x)
    return [(column, row) for row, columns in drawn.items() for column in range(min(columns), max(columns) + 1)]


def by_hand(costmap, pose, outline, multipliers=(1.0, 1.0, 1.0)):
    """State and cost of one pose, cell by cell."""
    grid = costmap.grid
    corners = Pose2D(*pose).transform_points(outline) if len(outline) else np.array([pose[:2]])
    if not all(grid.contains_point(x, y) for x, y in corners):
        return PoseState.OUTSIDE, 0.0
    state, cost = PoseState.FREE, 0.0
    for column, row in covered_cells(grid, outline, Pose2D(*pose)):
        value = int(costmap.costs[row, column])
        kind, factor = {
            LETHAL: (PoseState.LETHAL, multipliers[0]), INSCRIBED: (PoseState.INSCRIBED, multipliers[1]),
            NO_INFORMATION: (PoseState.UNKNOWN, multipliers[2]),
        }.get(value, (PoseState.FREE, 1.0))
        state, cost = max(state, kind), cost + value * (factor or 1.0)
    return state, cost


seeds = st.integers(0, 10 ** 6)
poses = st.tuples(st.floats(-1.2, 1.2), st.floats(-0.7, 1.2), st.floats(-4.0, 4.0))


@given(seeds, poses, st.tuples(*[st.sampled_from([0.0, 0.5, 1.0, 10.0])] * 3))
@settings(max_examples=100)
def test_a_pose_is_the_sum_of_its_cells(seed, pose, multipliers):
    costmap = random_costmap(seed)
    for outline in (BURGER, POINT):
        verdict = check_poses(costmap, np.array([pose]), outline, Multipliers(*multipliers))[0]
        assert (verdict.state, verdict.cost) == pytest.approx(by_hand(costmap, pose, outline, multipliers))


def test_a_point_is_its_cell():
    costmap = random_costmap(3)
    for row in range(30):
        for column in range(40):
            assert check_point(costmap, *costmap.grid.center_of(column, row)).cost == costmap.costs[row, column]
    assert check_point(costmap, 9.0, 0.0) == (PoseState.OUTSIDE, 0.0)


@given(seeds, st.lists(poses, max_size=12), st.integers(0, 4), st.integers(0, 3))
@settings(max_examples=100)
def test_a_path_is_the_sum_of_its_poses_up_to_the_first_bad_one(seed, path, return_on, skip):
    costmap = random_costmap(seed, free=0.85)
    worst, total, last, index = PoseState.FREE, 0.0, 0, 0
    while index < len(path):
        last = index
        state, cost = by_hand(costmap, path[index], BURGER)
        worst, total = max(worst, state), total + cost
        if return_on and worst >= return_on:
            break
        index += 1 + skip
    verdict, checked = check_path(
        costmap, np.array(path).reshape(-1, 3), BURGER, return_on=return_on, skip_poses=skip
    )
    assert (verdict.state, verdict.cost, checked) == pytest.approx((worst, total, last))


@given(seeds, poses, st.floats(0.0, 0.4), st.floats(0.0, 1.0))
@settings(max_examples=40)
def test_the_nearest_valid_pose_is_found(seed, start, distance, angle):
    costmap = random_costmap(seed, free=0.85)
    start = Pose2D(*start)
    found = find_valid_pose(costmap, start, BURGER, distance, angle)
    assert start.distance_to(found.pose) <= distance + 1e-9
    assert abs(angle_between(start.theta, found.pose.theta)) <= angle + 1e-9
    grid = costmap.grid
    best = math.inf
    wanted_fits = by_hand(costmap, start, BURGER)[0] <= PoseState.INSCRIBED
    if wanted_fits and check_point(costmap, start.x, start.y).state is PoseState.FREE:
        best = 0.0
    for row in range(grid.height):
        for column in range(grid.width):
            x, y = grid.center_of(column, row)
            away = math.hypot(x - start.x, y - start.y)
            if away <= distance and costmap.costs[row, column] < INSCRIBED:
                if by_hand(costmap, (x, y, start.theta), BURGER)[0] <= PoseState.INSCRIBED:
                    best = min(best, away)
    if found.verdict.state <= PoseState.INSCRIBED:
        assert by_hand(costmap, found.pose, BURGER) == pytest.approx(tuple(found.verdict))
        assert start.distance_to(found.pose) <= best + 1e-9
    else:
        assert best == math.inf
    if found.verdict.state is PoseState.LETHAL:
        assert found.pose == start


def test_turning_may_be_what_makes_it_fit():
    grid = Grid(0.05, -1.0, -1.0, 40, 40)
    costs = np.full(grid.shape, LETHAL, dtype=np.uint8)
    costs[18:22, :] = 0
    costmap = CostGrid(grid, costs, "map", BURGER, 0.04, 0.15)
    long = np.array([[-0.3, -0.05], [-0.3, 0.05], [0.3, 0.05], [0.3, -0.05]])
    across = Pose2D(0.01, 0.01, math.pi / 2.0)
    assert find_valid_pose(costmap, across, long, 0.2, 0.5).verdict.state is PoseState.LETHAL
    found = find_valid_pose(costmap, across, long, 0.2, math.pi)
    assert found.verdict.state is PoseState.FREE and abs(abs(found.pose.theta) - math.pi / 2.0) > 1.2


@pytest.mark.parametrize("anywhere", [1e17, 3.4e38])
def test_a_robot_that_may_stand_anywhere_is_found_a_place(anywhere):
    grid = Grid(0.05, -1.0, -1.0, 40, 40)
    costs = np.zeros(grid.shape, dtype=np.uint8)
    costs[:, 20:] = LETHAL
    costmap = CostGrid(grid, costs, "map", BURGER, 0.04, 0.15)
    found = find_valid_pose(costmap, Pose2D(0.5, 0.0, 0.0), BURGER, anywhere, 0.0)
    assert found.verdict.state is PoseState.FREE and -0.2 < found.pose.x < 0.0


def test_unknown_space_is_a_better_answer_than_outside():
    grid = Grid(0.05, 0.0, 0.0, 20, 20)
    costs = np.zeros(grid.shape, dtype=np.uint8)
    costs[:, 4:] = NO_INFORMATION
    costmap = CostGrid(grid, costs, "map", BURGER, 0.04, 0.15)
    found = find_valid_pose(costmap, Pose2D(0.01, 0.5, 0.0), 1.4 * BURGER, 0.3, 0.0)
    assert found.verdict.state is PoseState.UNKNOWN
