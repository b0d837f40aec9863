"""The robot's outline, and the cells it frees."""

import math

import numpy as np
import pytest

from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.obstacle_layer import free_within
from mbf_relay.costmap.outline import clearances, footprint_from_radius, padded, parse_footprint, radii
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid

BURGER = np.array([[-0.105, -0.105], [-0.105, 0.105], [0.041, 0.105], [0.041, -0.105]])


def test_reads_lists_and_texts():
    expected = [[-0.1, 0.0], [0.1, 0.1], [0.1, -0.1]]
    assert parse_footprint(expected).tolist() == expected
    assert parse_footprint("[[-0.1, 0], [0.1, 0.1], [0.1, -0.1]]").tolist() == expected
    assert parse_footprint("[]").shape == (0, 2)


@pytest.mark.parametrize(
    "value",
    [
        [[0, 0], [1, 1]],
        "[[0,0],[1,1]]",
        [[0, 0, 1], [1, 1], [2, 2]],
        "nonsense(",
        3,
        [[0, "a"], [1, 1], [2, 2]],
        [[0, math.inf], [1, 1], [2, 0]],
    ],
)
def test_bad_footprints_are_named_with_their_value(value):
    with pytest.raises(ValueError, match="footprint is"):
        parse_footprint(value)


def test_radii_of_the_burger():
    inscribed, circumscribed = radii(BURGER)
    assert inscribed == pytest.approx(0.041)
    assert circumscribed == pytest.approx(math.hypot(0.105, 0.105))


def test_padding_moves_each_corner_outwards_along_both_axes():
    assert np.abs(padded(BURGER, 0.01)) == pytest.approx(np.abs(BURGER) + 0.01)


POSES = [Pose2D(0.013, 0.021, 0.0), Pose2D(0.0, 0.0, 0.7), Pose2D(-0.03, 0.31, -2.2), Pose2D(0.45, 0.4, 1.0)]


def plainly_within(grid, outline, pose):
    """Return the cells no corner of which lies outside of an edge of a convex outline."""
    corners = pose.transform_points(outline)
    turn = 1.0 if np.cross(corners[1] - corners[0], corners[2] - corners[1]) > 0.0 else -1.0
    rows, columns = np.mgrid[:grid.height + 1, :grid.width + 1]
    points = grid.resolution * np.stack((columns, rows), axis=-1) + (grid.origin_x, grid.origin_y)
    inside = np.ones(rows.shape, dtype=bool)
    for start, end in zip(corners, np.roll(corners, -1, axis=0)):
        inside &= turn * np.cross(end - start, points - start) >= 0.0
    whole = inside[:-1, :-1] & inside[:-1, 1:] & inside[1:, :-1] & inside[1:, 1:]
    return {(column, row) for row, column in np.argwhere(whole).tolist()}


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("outline", [BURGER, BURGER[::-1], footprint_from_radius(0.2)])
def test_cells_freed_lie_wholly_under_the_robot(pose, outline):
    grid = Grid(0.025, -0.5, -0.5, 40, 40)
    costs = np.full((40, 40), 254, dtype=np.uint8)
    free_within(grid, costs, outline, pose)
    freed = {(column, row) for row, column in np.argwhere(costs == 0).tolist()}
    assert freed == plainly_within(grid, outline, pose) != set()


@pytest.mark.parametrize("value, said", [
    ([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], "encloses no area"),
    ([[3.0, 3.0], [4.0, 3.0], [4.0, 4.0], [3.0, 4.0]], "does not hold the base frame's origin"),
])
def test_a_robot_without_width_or_off_its_frame_is_refused_at_run_time_too(value, said):
    """Files were looked at; by reconfiguring and in the guard a robot of no width fitted through everything."""
    costmap = build_costmap("local_costmap", {"rolling_window": True, "width": 2.0, "height": 2.0, "robot_radius": 0.2})
    with pytest.raises(ValueError, match=said):
        costmap.parameters.replace(footprint=str(value))
    with pytest.raises(ValueError, match=said):
        VelocityGuardParameters(footprint=value)


def test_a_rectangle_told_crosswise_is_the_whole_rectangle_and_is_told_of():
    crossed = [[0.3, 0.2], [-0.3, -0.2], [0.3, -0.2], [-0.3, 0.2]]
    points = np.random.default_rng(5).uniform(-0.5, 0.5, (500, 2))
    inside = (np.abs(points) <= (0.3, 0.2)).all(axis=1)
    for kind in (CostmapParameters, VelocityGuardParameters):
        parameters, (note,) = kind.read({"footprint": str(crossed)})
        assert ((clearances(points, parameters.outline()) <= 0.0) == inside).all()
        assert "footprint" in note and "crosses itself" in note
    assert CostmapParameters.read({"footprint": [crossed[0], crossed[3], crossed[1], crossed[2]]})[1] == []


def test_a_star_of_many_corners_is_looked_at_at_once():
    angles = np.arange(1000) * 2.0 * math.pi / 1000
    star = np.column_stack((np.cos(angles), np.sin(angles))) * np.where(np.arange(1000) % 2, 1.0, 0.5)[:, None]
    assert len(parse_footprint(star)) == 1000


@pytest.mark.parametrize("points", [[[math.nan, 0.0]] * 1000, [[0.1, 0.1]] * 1000, [[1e9, 0.0]] * 500, ["x" * 10**6]])
def test_the_refusal_of_a_long_footprint_does_not_fill_the_log_of_the_robot(points):
    for value in (points, str(points)):
        with pytest.raises(ValueError) as refusal:
            parse_footprint(value)
        assert len(str(refusal.value)) < 400 and "footprint" in str(refusal.value)
