"""The footprint on a costmap: contacts, free stretches, sight and clearance, against plain references."""

import dataclasses
import math

import numpy as np
import pytest
import scipy.ndimage
from kinematics import BURGER, costmap_round
from plain_footprint import contacts, random_costmap

from mbf_relay.costmap import footprint_checker, footprint_checker_kernels
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.costmap.footprint_checker import FootprintChecker, distances_to_obstacles
from mbf_relay.costmap.outline import FARTHEST, clearances
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid


def with_overlap(costmap, overlap):
    return FootprintChecker(dataclasses.replace(costmap, obstacle_overlap=overlap))


def test_poses_asked_together_touch_as_each_alone_does():
    rng = np.random.default_rng(3)
    checker = FootprintChecker(random_costmap(rng, obstacles=60))
    poses = rng.uniform((-1.55, -1.55, -7.0), (1.55, 1.55, 7.0), (500, 3))
    assert checker.touches(poses).tolist() == [checker.contacts_at(Pose2D(*pose)) > 0 for pose in poses]


@pytest.mark.parametrize("unknown_touches", [True, False])
def test_poses_of_a_path_touch_where_each_would_alone(unknown_touches):
    rng = np.random.default_rng(4)
    touching = 0
    for obstacles in range(0, 200, 10):
        costmap = random_costmap(rng, obstacles=obstacles)
        costmap.costs[tuple(rng.integers(0, 60, (2, obstacles // 4)))] = 255
        checker = FootprintChecker(costmap, unknown_touches)
        begin, end = rng.uniform(-1.6, 1.6, (2, 2))
        points = begin + (end - begin) * np.linspace(0.0, 1.0, 75)[:, None]
        poses = np.column_stack((points, rng.uniform(-7.0, 7.0) + 0.02 * np.arange(75)))
        expected = [checker.contacts_at(Pose2D(*pose)) > 0 for pose in poses]
        assert checker.touches(poses).tolist() == expected
        touching += sum(expected)
    assert 100 < touching < 1400


def test_unknown_cells_and_the_grids_edge_may_be_no_obstacle():
    costmap = random_costmap(np.random.default_rng(1), obstacles=0)
    costmap.costs[:] = 0
    costmap.costs[:, 40:] = 255
    unknown, outside, lethal = Pose2D(0.6, 0.0, 0.0), Pose2D(-1.49, 0.0, 0.0), Pose2D(0.0, 0.6, 0.0)
    costmap.costs[42:45, 20:40] = 254
    for strict in (True, False):
        checker = FootprintChecker(costmap, unknown_touches=strict)
        assert checker.touches(np.array([unknown, outside, lethal])).tolist() == [strict, strict, True]


def test_the_largest_robot_takes_no_more_memory_than_a_machine_has_and_is_off_by_a_cell_at_most():
    costmap = random_costmap(np.random.default_rng(1), obstacles=0)
    reach = FARTHEST * costmap.grid.resolution / math.sqrt(2.0)
    square = reach * np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, -1.0], [-1.0, 1.0]])
    outlines = FootprintChecker(dataclasses.replace(costmap, footprint=square))._outlines
    assert outlines.nbytes <= 2 ** 27
    assert math.pi * FARTHEST / len(outlines) < 1.5


def test_a_large_robots_corners_are_turned_as_finely_as_a_small_ones():
    costmap = random_costmap(np.random.default_rng(1), obstacles=0, footprint=6.0 * BURGER)
    costmap.costs[:] = 0
    costmap.costs[30, 48] = 254
    checker = FootprintChecker(costmap)
    headings = np.linspace(-math.pi, math.pi, 2000)
    poses = np.column_stack((np.zeros((2000, 2)), headings))
    expected = [contacts(costmap, Pose2D(*pose), headings=100_000) > 0 for pose in poses]
    assert (checker.touches(poses) == expected).mean() > 0.99


@pytest.mark.parametrize("overlap", [0.0, 0.25])
def test_contacts_are_those_of_a_walk_round_the_outline(overlap):
    rng = np.random.default_rng(5)
    agreed = total = touching = 0
    for _ in range(20):
        costmap = random_costmap(rng, obstacles=60)
        checker = with_overlap(costmap, overlap)
        for _ in range(20):
            pose = Pose2D(*rng.uniform((-1.55, -1.55, -7.0), (1.55, 1.55, 7.0)))
            scale = float(rng.choice([1.0, 1.2]))
            found, expected = checker.contacts_at(pose, scale), contacts(checker.costmap, pose, scale)
            agreed, total, touching = agreed + (found == expected), total + 1, touching + (expected > 0)
            assert abs(found - expected) <= 2, "a point on the edge of a cell may round either way"
    assert agreed >= 0.97 * total and touching > 50


def test_a_cell_is_nearly_full_only_without_overlap():
    costmap = random_costmap(np.random.default_rng(1), obstacles=0)
    costmap.costs[:] = 0
    costmap.costs[30, 40] = 254  # x from 0.50 to 0.55, y from 0 to 0.05
    ahead = Pose2D(0.47, 0.025, 0.0)  # the front edge at 0.511, a fifth of the cell inside
    assert with_overlap(costmap, 0.0).contacts_at(ahead) > 0
    assert with_overlap(costmap, 0.25).contacts_at(ahead) == 0
    assert with_overlap(costmap, 0.25).contacts_at(Pose2D(0.48, 0.025, 0.0)) > 0


def arcs_from(rng, number, steps):
    """Ways of up to half a cell or a few degrees a step, as controllers look at them; shape (number, steps, 3)."""
    moves = rng.uniform((-0.025, -0.01, -0.1), (0.025, 0.01, 0.1), (number, 1, 3))
    moves = moves * np.arange(1, steps + 1)[None, :, None]
    return rng.uniform((-1.2, -1.2, -3.0), (1.2, 1.2, 3.0), (number, 1, 3)) + moves


@pytest.mark.parametrize("obstacles", [5, 20, 80])
@pytest.mark.parametrize("resized", [1.0, 3.0])
@pytest.mark.parametrize("arcs", [False, True])
def test_first_contacts_count_free_poses_and_sum_the_costs_under_them(obstacles, resized, arcs):
    rng = np.random.default_rng(7)
    costmap = random_costmap(rng, obstacles, footprint=resized * BURGER)
    checker = FootprintChecker(costmap)
    steps = 40 if arcs else 10
    poses = arcs_from(rng, 400, steps) if arcs else rng.uniform((-1.4, -1.4, -3.0), (1.4, 1.4, 3.0), (400, steps, 3))
    counts, scales = rng.integers(1, steps + 1, 400), rng.choice([1.0, 1.3], 400)
    free, highest, summed = checker.first_contacts(poses, counts, scales)
    for n in range(400):
        touching = [checker.contacts_at(Pose2D(*pose), scales[n]) > 0 for pose in poses[n, : counts[n]]]
        expected = touching.index(True) if True in touching else counts[n]
        cells = costmap.grid.cells_at(poses[n, :expected, :2])
        costs = costmap.costs[cells[:, 1], cells[:, 0]].astype(float)
        assert free[n] == expected
        assert highest[n] == (costs.max() if expected else 0.0) and summed[n] == pytest.approx(costs.sum())


def empty_costmap():
    costmap = random_costmap(np.random.default_rng(1), obstacles=0)
    costmap.costs[:] = 0
    return costmap


@pytest.mark.parametrize("heading", np.arange(4) * math.pi / 2.0)
def test_a_way_ends_at_the_costmaps_edge_where_the_unknown_is_no_obstacle(heading):
    checker = FootprintChecker(empty_costmap(), unknown_touches=False)
    way = Pose2D(0.0, 0.0, heading).transform_poses(np.column_stack((np.arange(1.405, 1.6, 0.01), np.zeros((20, 2)))))
    assert checker.free_steps(way) == 10


def test_what_touches_already_may_be_left_and_not_entered_further():
    costmap = empty_costmap()
    costmap.costs[:, 42:] = 254  # from x = 0.6 on
    checker = FootprintChecker(costmap)
    inside = Pose2D(0.60, 0.0, 0.0)
    assert checker.contacts_at(inside) > 0
    steps = 0.01 * np.arange(1, 6)
    back = np.column_stack((inside.x - steps, np.zeros((5, 2))))
    turned = np.column_stack((np.full((5, 2), (inside.x, 0.0)), 0.2 * np.arange(1, 6)))
    assert checker.free_steps(back, inside) == 5
    assert checker.free_steps(back) == 0
    assert checker.free_steps(turned, inside) < 5


@pytest.mark.parametrize("heading", np.linspace(0.0, 1.5, 7))
@pytest.mark.parametrize("wide", [False, True])
def test_one_with_something_at_its_side_drives_off_along_it(heading, wide):
    """It stood for good beside a cell that its side touched: a few millimetres on, another point of the outline did."""
    costmap = empty_costmap()
    cells = costmap.grid.cells_at(Pose2D(0.4, 0.4, heading).transform_points(np.array([[-0.03, 0.11]])))
    (column, row), = cells
    costmap.costs[row, column] = 254
    here = Pose2D(*(costmap.grid.origin_x + 0.05 * (column + 0.5), costmap.grid.origin_y + 0.05 * (row + 0.5)), heading)
    checker = FootprintChecker(costmap)
    for ahead in (1.0, -1.0):
        start = here.compose(Pose2D(-0.03 * ahead, -0.11 if not wide else -0.115, 0.0))  # a fifth of a cell too near
        assert checker.contacts_at(start) > 0
        way = start.transform_poses(np.column_stack((ahead * 0.005 * np.arange(1, 40), np.zeros((39, 2)))))
        assert checker.free_steps(way, start) == 39


def test_one_that_touches_comes_no_nearer():
    """It crept on into what it touched, a few millimetres a second, until it could not even turn away."""
    costmap = empty_costmap()
    costmap.costs[:, 42:] = 254
    checker = FootprintChecker(costmap)
    for depth in (0.012, 0.02, 0.03):
        here = Pose2D(0.6 + depth - 0.041, 0.0, 0.0)
        assert checker.contacts_at(here) > 0
        nearer = np.column_stack((here.x + 0.001 * np.arange(1, 11), np.zeros((10, 2))))
        assert checker.free_steps(nearer, here) <= 2


@pytest.mark.parametrize("way", [1e-4, 1e-3])
def test_a_robot_that_creeps_gets_no_deeper_into_what_it_touches_step_by_step(way):
    """A twentieth of a cell was allowed, and each cycle again: a large robot crept 4 cm into a box."""
    costmap = empty_costmap()
    costmap.costs[:, 42:] = 254  # from x = 0.6 on
    checker = FootprintChecker(costmap)
    pose = Pose2D(0.6, 0.0, 0.0)
    for _ in range(100):
        ahead = np.array([[pose.x + way, 0.0, 0.0]])
        if checker.free_steps(ahead, pose):
            pose = Pose2D(*ahead[0])
    assert pose.x - 0.6 < 0.1 * costmap.grid.resolution * 0.05


class Counting:
    """The kernels, and how much each batch of trajectories had them look at."""

    def __init__(self):
        self.looked_at = []

    def __getattr__(self, name):
        return getattr(footprint_checker_kernels, name)

    def first_contacts(self, *arguments):
        self.looked_at.append(footprint_checker_kernels.first_contacts(*arguments))


@pytest.mark.parametrize("corners", [4, 1000])
def test_a_large_robot_half_on_unknown_ground_is_held_and_not_thought_about_for_half_a_minute(monkeypatch, corners):
    """How deep it lay in each of 100 000 unknown cells was asked at each of 20 000 poses, by every side of it."""
    monkeypatch.setattr(footprint_checker, "footprint_checker_kernels", Counting())
    angles = 2.0 * math.pi * (np.arange(corners) + 0.5) / corners
    outline = 0.99 * FARTHEST * 0.01 * np.column_stack((np.cos(angles), np.sin(angles)))
    costmap = CostGrid(Grid(0.01, -8.0, -8.0, 1600, 1600), np.zeros((1600, 1600), np.uint8), "odom", outline, 1.0, 4.0)
    costmap.costs[:, :800] = 255
    ways = np.zeros((800, 25, 3))
    ways[:, :, 0] = np.linspace(0.0, 0.3, 800)[:, None] * np.linspace(0.0, 1.0, 25)
    way = FootprintChecker(costmap).first_contacts(ways, np.full(800, 25), np.ones(800), Pose2D(0.0, 0.0, 0.0))
    looked_at, = footprint_checker.footprint_checker_kernels.looked_at
    assert looked_at <= 2 * footprint_checker_kernels.MOST_LOOKED_AT
    assert way.steps.max() < 25


def test_a_car_along_a_wall_it_touches_is_thought_about_on_every_way(monkeypatch):
    monkeypatch.setattr(footprint_checker, "footprint_checker_kernels", Counting())
    car = np.array([[-1.0, -1.0], [-1.0, 1.0], [3.5, 1.0], [3.5, -1.0]])
    costmap = CostGrid(Grid(0.05, -10.0, -10.0, 400, 400), np.zeros((400, 400), np.uint8), "odom", car, 1.0, 3.65)
    costmap.costs[219:260, 40:380] = 254
    ways = np.zeros((860, 50, 3))
    ways[:, :, 0] = np.linspace(0.0, 1.5, 860)[:, None] * np.linspace(0.02, 1.0, 50)
    way = FootprintChecker(costmap).first_contacts(ways, np.full(860, 50), np.ones(860), Pose2D(0.0, 0.0, 0.0))
    assert (way.steps == 50).all()
    assert footprint_checker.footprint_checker_kernels.looked_at[0] > 10_000_000


@pytest.mark.parametrize("outline", [BURGER, np.array([[-0.1, -0.05], [-0.04, 0.11], [0.06, 0.05], [0.13, -0.1]])])
@pytest.mark.parametrize("heading", [0.0, 0.3, math.pi / 2.0, 2.5, -1.1])
def test_every_cell_of_an_outline_of_any_heading_counts_in_how_deep_it_is(heading, outline):
    """The sum of depths is that over all cells, each by its distance from the outline."""
    costmap = random_costmap(np.random.default_rng(6), obstacles=0, footprint=outline)
    costmap.costs[:] = 254
    checker, pose = with_overlap(costmap, 0.2), Pose2D(0.31, -0.22, heading)
    rows, columns = np.mgrid[:60, :60]
    centers = pose.inverse().transform_points(costmap.grid.origin_x + 0.05 * np.column_stack(
        (columns.ravel() + 0.5, rows.ravel() + 0.5)))
    entered = 0.3 - clearances(centers, outline) / 0.05
    assert checker.depths_at(pose) == pytest.approx([entered.max(), entered[entered > 0.0].sum()])


def test_how_deep_a_footprint_is_in_something_is_the_way_back_out():
    costmap = empty_costmap()
    costmap.costs[30, 42] = 254  # its centre at (0.625, 0.025)
    checker = with_overlap(costmap, 0.2)
    for heading in (0.0, 0.3, 1.0):
        for entered in (0.1, 0.2, 0.5, 1.2):
            before = 0.041 + 0.05 * (0.3 - entered)
            pose = Pose2D(0.625, 0.025, heading).compose(Pose2D(-before, 0.02, 0.0))
            deepest, total = checker.depths_at(pose)
            touches = checker.contacts_at(pose) or entered > 0.3  # its centre is within the footprint
            assert deepest == total == pytest.approx(entered if touches else -1.0)
    assert (checker.depths_at(Pose2D(0.0, 0.0, 0.0)) < 0.0).all()


@pytest.mark.parametrize("heading", [0.0, 0.3])
def test_what_stands_within_the_outline_is_left_and_not_entered_deeper(heading):
    """No side touches it, and it was driven through from within."""
    costmap = empty_costmap()
    costmap.costs[30, 42] = 254  # its centre at (0.625, 0.025), 3 cm behind the front edge
    checker, begin = with_overlap(costmap, 0.2), Pose2D(0.625, 0.025, heading).compose(Pose2D(-0.011, 0.0, 0.0))
    assert checker.contacts_at(begin) == 0
    for direction, free in (1.0, 0), (-1.0, 40):
        poses = np.array([begin.compose(Pose2D(0.005 * direction * step, 0.0, 0.0)) for step in range(1, 41)])
        assert checker.free_steps(poses, begin) == free


def test_distances_are_to_the_nearest_lethal_or_unknown_cell():
    rng = np.random.default_rng(2)
    costs = rng.choice([0, 252, 253, 254, 255], (20, 30), p=[0.7, 0.1, 0.17, 0.02, 0.01]).astype(np.uint8)
    rows, columns = np.nonzero(costs >= 254)
    y, x = np.mgrid[:20, :30]
    expected = np.hypot(x[..., None] - columns, y[..., None] - rows).min(axis=2)
    assert np.allclose(distances_to_obstacles(costs), expected, atol=1e-4)
    assert (distances_to_obstacles(np.zeros((5, 5), np.uint8)) > 1e5).all()


def test_clearance_along_a_path_is_right_as_far_as_it_is_asked_for():
    rng = np.random.default_rng(11)
    beyond = 0
    for _ in range(300):
        costmap = random_costmap(rng, obstacles=8)
        points = rng.uniform(-1.0, 1.0, 2) + np.cumsum(rng.uniform(-0.03, 0.03, (20, 2)), axis=0)
        expected, farthest = FootprintChecker(costmap).clearance_along(points), rng.uniform(0.0, 0.6)
        assert FootprintChecker(costmap).clearance_along(points, expected) == expected
        found = FootprintChecker(costmap).clearance_along(points, farthest)
        beyond += expected > farthest
        assert found > farthest if expected > farthest else found == expected
    assert 60 < beyond < 240


def test_what_was_asked_of_what_is_near_leaves_what_is_far_as_it_is():
    costmap = random_costmap(np.random.default_rng(3), obstacles=3)
    checker, points = FootprintChecker(costmap), np.random.default_rng(4).uniform(-1.8, 1.8, (80, 2))  # some off it
    expected = [FootprintChecker(costmap).clearance_at(x, y) for x, y in points]
    checker.clearance_along(points, 0.01)
    checker.free_steps(np.zeros((1, 3)))
    assert checker.clearances_at(points) == pytest.approx(expected)


def test_sight_ends_at_obstacles_and_is_not_judged_outside():
    costmap = random_costmap(np.random.default_rng(1), obstacles=0)
    costmap.costs[:] = 0
    costmap.costs[25:35, 40] = 254
    checker = FootprintChecker(costmap)
    points = np.array([[0.4, 0.0], [0.8, 0.0], [0.8, 1.0], [5.0, 5.0]])
    assert checker.in_sight(Pose2D(0.0, 0.0, 0.0), points).tolist() == [True, False, True, True]


def test_a_way_is_seen_where_no_corner_comes_behind_an_obstacle():
    """A wall that the robot comes up to, as deep as a cell is marked, or passes along, hides nothing of it."""
    costmap = empty_costmap()
    costmap.costs[25:28, 40:] = 254  # x from 0.5, y from -0.25 to -0.1
    checker, here = FootprintChecker(costmap), Pose2D(0.0, 0.02, 0.0)
    ahead = np.array([[x, 0.02, 0.0] for x in np.arange(0.0, 0.9, 0.02)])
    up_to_it = np.array([[x, -0.18, 0.0] for x in np.arange(0.0, 0.48, 0.02)])
    assert checker.sees_way(here, ahead) and checker.sees_way(Pose2D(0.0, -0.18, 0.0), up_to_it)
    below = np.array([[x, -0.45, 0.0] for x in np.arange(0.3, 0.7, 0.02)])
    assert not checker.sees_way(here, below) and checker.sees_way(Pose2D(0.3, -0.45, 0.0), below)


def test_a_way_is_seen_where_each_of_its_corners_is():
    rng = np.random.default_rng(6)
    seen = 0
    for _ in range(60):
        checker = FootprintChecker(random_costmap(rng, obstacles=60))
        here = Pose2D(*rng.uniform((-0.5, -0.5, -3.0), (0.5, 0.5, 3.0)))
        way = np.array([here.compose(Pose2D(ahead, 0.3 * ahead, ahead)) for ahead in np.arange(0.0, 0.5, 0.03)])
        corners = np.concatenate([Pose2D(*pose).transform_points(checker.costmap.footprint) for pose in way])
        away = corners - here[:2]
        apart = footprint_checker.APART * checker.costmap.grid.resolution
        nearer = np.maximum(0.0, 1.0 - apart / np.hypot(*away.T)[:, None])
        assert checker.sees_way(here, way) == checker.in_sight(here, here[:2] + nearer * away).all()
        seen += checker.sees_way(here, way)
    assert 10 < seen < 50


def test_what_is_right_behind_a_point_robot_hides_nothing_of_its_way_ahead():
    """Of what it comes to within a cell or two, the place as far on the other side of it was looked at."""
    costmap = random_costmap(np.random.default_rng(1), obstacles=0, footprint=np.zeros((0, 2)))
    costmap.costs[:] = 0
    costmap.costs[30, 29] = 254
    way = np.array([[x, 0.02, 0.0] for x in np.arange(0.03, 0.5, 0.02)])
    assert FootprintChecker(costmap).sees_way(Pose2D(0.01, 0.02, 0.0), way)


def test_a_point_robot_has_an_outline_of_one_point():
    costmap = random_costmap(np.random.default_rng(1), obstacles=0, footprint=np.zeros((0, 2)))
    costmap.costs[:] = 0
    costmap.costs[30, 40] = 254
    checker = with_overlap(costmap, 0.0)
    assert checker.contacts_at(Pose2D(0.52, 0.02, 1.0)) == 1 and checker.contacts_at(Pose2D(0.48, 0.02, 1.0)) == 0
    assert BURGER.shape == (4, 2)


@pytest.mark.parametrize("seed", range(5))
def test_clearance_is_interpolated_between_cells(seed):
    rng = np.random.default_rng(seed)
    costmap = random_costmap(rng)
    checker, distances = FootprintChecker(costmap), distances_to_obstacles(costmap.costs)
    points = rng.uniform(-1.7, 1.7, (30, 2))
    places = (points + 1.5) / 0.05 - 0.5
    inside = ((places >= 0.0) & (places < 59.0)).all(axis=1)
    expected = scipy.ndimage.map_coordinates(distances.astype(float), places[inside].T[::-1], order=1)
    for point, clearance in zip(points[inside], expected):
        assert checker.clearance_along(point[None]) == pytest.approx(0.05 * (clearance - 0.5) - 0.105, abs=1e-6)
    assert checker.clearance_along(points) == pytest.approx(0.05 * (expected.min() - 0.5) - 0.105, abs=1e-6)
    assert checker.clearance_along(points[~inside][:1]) == math.inf


def test_clearance_does_not_jump_where_a_path_lies_a_hair_aside():
    checker = FootprintChecker(random_costmap(np.random.default_rng(2)))
    line = np.column_stack((np.linspace(-0.4, 0.4, 30), np.zeros(30)))
    clearances = [checker.clearance_along(line + (0.0, aside)) for aside in np.arange(-0.2, 0.2, 0.001)]
    assert np.ptp(clearances) > 0.03 and np.abs(np.diff(clearances)).max() < 0.0015


def test_a_footprint_leaves_the_grid_with_its_first_corner():
    checker = FootprintChecker(costmap_round(Pose2D(0.0, 0.0, 0.0), size=1.0))
    reach = 0.5 - BURGER[:, 0].max()
    poses = np.array([
        (0.0, 0.0, 0.0), (reach - 0.01, 0.0, 0.0), (reach + 0.01, 0.0, 0.0), (0.0, reach - 0.01, math.pi / 2.0),
        (0.0, reach + 0.01, math.pi / 2.0), (-reach - 0.01, 0.0, math.pi), (reach - 0.01, 0.0, -0.5)])
    assert checker.leaves_grid(poses).tolist() == [False, False, True, False, True, True, True]
