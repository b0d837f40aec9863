"""Places that a robot's files say it must not go to are not driven on."""

import math

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.geometry import IDENTITY, Pose2D

POINT, LINE = [1.0, -1.0], [[-2.0, 1.0], [-1.0, 2.0]]
CORNER = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]  # an L, which is not convex


def costmap_with(areas, rolling=False, **layer):
    costmap = build_costmap("local_costmap", {
        "global_frame": "odom", "rolling_window": rolling,
        "width": 6.0, "height": 6.0, "resolution": 0.05, "origin_x": -3.0, "origin_y": -3.0,
        "robot_radius": 0.1, "plugins": [
            {"name": "zones", "type": "costmap_prohibition_layer_namespace::CostmapProhibitionLayer"}],
        "zones": {"prohibition_areas": areas, **layer},
    })
    costmap.update(1.0, IDENTITY)
    return costmap


def is_lethal(costmap, x, y):
    seen = costmap.snapshot()
    column, row = seen.grid.cell_at(x, y)
    assert seen.costs[row, column] in (FREE_SPACE, LETHAL)
    return bool(seen.costs[row, column] == LETHAL)


def test_points_lines_and_polygons_of_any_form_are_prohibited_and_nothing_else_is():
    costmap = costmap_with([POINT, LINE, CORNER])
    assert is_lethal(costmap, *POINT) and not is_lethal(costmap, 1.1, -1.0)
    assert all(is_lethal(costmap, -2.0 + share, 1.0 + share) for share in np.linspace(0.0, 1.0, 50))
    assert not is_lethal(costmap, -1.5, 1.7)
    seen = costmap.snapshot()
    for row in range(0, 120, 3):
        for column in range(0, 120, 3):
            x, y = -3.0 + (column + 0.5) * 0.05, -3.0 + (row + 0.5) * 0.05
            in_corner = 0.0 < x < 2.0 and 0.0 < y < 2.0 and not (x > 1.0 and y > 1.0)
            on_rim = min(abs(x % 1.0), 1.0 - abs(x % 1.0), abs(y % 1.0), 1.0 - abs(y % 1.0)) < 0.06
            if not on_rim and math.hypot(x - 1.0, y + 1.0) > 0.1 and abs(y - x - 3.0) > 0.1:
                assert bool(seen.costs[row, column] == LETHAL) is in_corner, (x, y)


def test_slanted_areas_are_prohibited_up_to_their_sides():
    corners = np.array([[-1.0, -1.0], [2.0, 0.5], [0.0, 2.0]])
    seen = costmap_with([corners.tolist()]).snapshot()
    sides = np.roll(corners, -1, axis=0) - corners
    for row in range(0, 120, 2):
        for column in range(0, 120, 2):
            away = np.array([-3.0 + (column + 0.5) * 0.05, -3.0 + (row + 0.5) * 0.05]) - corners
            inward = (sides[:, 0] * away[:, 1] - sides[:, 1] * away[:, 0]) / np.hypot(*sides.T)
            if abs(inward.min()) > 0.05:  # m; beside a side it depends on which cells the line passes
                assert bool(seen.costs[row, column] == LETHAL) is bool(inward.min() > 0.0), (row, column)


def test_the_outline_alone_is_prohibited_where_asked():
    costmap = costmap_with([CORNER], fill_polygons=False)
    assert is_lethal(costmap, 1.5, 1.0) and is_lethal(costmap, 0.0, 1.3) and not is_lethal(costmap, 0.5, 0.5)


def test_areas_stay_in_the_map_while_odometry_drifts():
    costmap = costmap_with([[[0.5, 0.5], [1.0, 0.5], [1.0, 1.0], [0.5, 1.0]]])
    before, map_from_odom = costmap.snapshot().costs.copy(), Pose2D(0.4, -0.3, 0.5)
    costmap.set_map_from_costmap(map_from_odom, "zones")
    costmap.update(1.1, IDENTITY)
    assert costmap.layers[0].map_frame == "map"
    x, y = map_from_odom.inverse().transform_points(np.array([[0.75, 0.75]]))[0]
    assert is_lethal(costmap, x, y)
    x, y = map_from_odom.inverse().transform_points(np.array([[0.3, 0.75]]))[0]
    assert not is_lethal(costmap, x, y)
    costmap.set_map_from_costmap(IDENTITY, "zones")
    costmap.update(1.2, IDENTITY)
    assert (costmap.snapshot().costs == before).all(), "and leave nothing behind"


def test_a_robot_that_comes_near_does_not_drive_into_what_lay_beyond_its_window():
    costmap = costmap_with([[[4.0, -1.0], [5.0, -1.0], [5.0, 1.0], [4.0, 1.0]], POINT], rolling=True)
    for x in (0.5, 1.5, 2.5):
        costmap.update(1.1 + x, Pose2D(x, 0.0, 0.0))
    assert is_lethal(costmap, 4.5, 0.0) and is_lethal(costmap, *POINT) and not is_lethal(costmap, 3.5, 0.0)
    costmap.update(9.0, IDENTITY)
    assert is_lethal(costmap, *POINT) and not is_lethal(costmap, 2.9, 0.0)


def test_what_is_prohibited_is_not_forgotten_where_costmaps_are_cleared():
    costmap = costmap_with([POINT])
    costmap.clear()
    costmap.update(1.1, IDENTITY)
    assert is_lethal(costmap, *POINT)


def test_areas_far_larger_than_the_costmap_are_drawn_at_once():
    costmap = costmap_with([[[-1e8, -1e8], [1e8, -1e8], [1e8, 0.0], [-1e8, 0.0]], [[-1e9, 1.0], [1e9, 1.0]]])
    assert is_lethal(costmap, 2.0, -1.0) and is_lethal(costmap, -2.9, 1.0) and not is_lethal(costmap, 2.0, 2.0)


@pytest.mark.parametrize("area", [
    [[-5.0, 0.5], [-4.0, 0.5]], [[0.5, -5.0], [0.5, -3.5]], [[-8.0, -6.0], [-6.0, -5.0], [-7.0, -4.5]],
    [[-5.0, -2.0], [-2.0, -5.0]], [[-4.0, -4.0]]])
def test_what_lies_beside_the_costmap_marks_nothing_on_it(area):
    assert not (costmap_with([area]).snapshot().costs == LETHAL).any()


@pytest.mark.parametrize("areas, words", [
    ("garden", "is 'garden'; it must be a list"), ([POINT, "x"], r"prohibition_areas\[1\] is 'x'"),
    ([[]], r"prohibition_areas\[0\] is \[\]"), ([[[1.0], [2.0]]], "must be a point"), ([7], r"\[0\] is 7"),
    ([[math.nan, 1.0]], "its coordinates must be finite metres"), ([[POINT, "y"]], "must be a point"),
    ([[[0.0, 0.0]] * 10001], "has 10001 corners; at most 10000")])
def test_what_is_no_area_is_named(areas, words):
    with pytest.raises(ValueError, match=words):
        costmap_with(areas)
