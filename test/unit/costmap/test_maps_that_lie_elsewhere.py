"""Maps that do not lie along the costmap's cells are laid on them where they belong."""

import math

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL, NO_INFORMATION
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.maps import OccupancyMap


def test_a_wall_of_a_second_map_as_large_as_the_first_stands_where_its_own_frame_has_it():
    """Its cells were taken for the costmap's, whatever lay between the frames: it was planned through the wall."""
    costmap = build_costmap("costmap", {
        "plugins": [{"name": name, "type": "StaticLayer"} for name in ("floor", "zones")],
        "zones": {"subscribe_to_updates": True, "use_maximum": True}})
    data = np.zeros((40, 40), np.int8)
    costmap.set_map(OccupancyMap(data, 0.1, IDENTITY), "floor")
    zones = data.copy()
    zones[10, 10] = 100
    costmap.set_map(OccupancyMap(zones, 0.1, IDENTITY), "zones")
    costmap.set_map_from_costmap(Pose2D(-1.0, -0.5, 0.0), "zones")
    costmap.update(0.0, IDENTITY)
    assert np.argwhere(costmap.snapshot().costs == LETHAL).tolist() == [[15, 20]]
    costmap.update_map(12, 10, np.full((1, 1), 100, np.int8), "zones")
    costmap.update(0.1, IDENTITY)
    assert np.argwhere(costmap.snapshot().costs == LETHAL).tolist() == [[15, 20], [15, 22]]


def map_alone():
    """Return a costmap that shows what a map says."""
    return build_costmap("costmap", {"plugins": [{"name": "static", "type": "StaticLayer"}]})


@pytest.mark.parametrize("turn", [0.3, -2.0, math.pi / 2.0])
def test_a_robot_can_be_sent_about_on_a_map_that_its_origin_turns(turn):
    """There was no costmap, so that nothing was planned; RViz, localization and rolling windows had it turned."""
    costmap, turned = map_alone(), Pose2D(1.0, -2.0, turn)
    data = np.zeros((30, 50), dtype=np.int8)
    data[3:5, 4:6], data[20:24, 30:34] = 100, -1
    costmap.set_map(OccupancyMap(data, 0.1, turned))
    costmap.update(0.0, IDENTITY)
    seen = costmap.snapshot()

    def cost_at(x, y):
        column, row = seen.grid.cell_at(*turned.transform_points(np.array([[x, y]]))[0])
        return seen.costs[row, column] if seen.grid.contains_cell(column, row) else None

    assert seen.grid.resolution == 0.1
    assert cost_at(0.5, 0.4) == LETHAL and cost_at(3.2, 2.2) == NO_INFORMATION
    corners = [cost_at(x, y) for x in (0.1, 4.9) for y in (0.1, 2.9)]
    assert corners == [FREE_SPACE] * 4, "all of it lies in the costmap"
    assert {cost_at(x, 1.5) for x in (-0.15, 5.15)} <= {NO_INFORMATION, None}, "nobody knows what lies beside it"
    costmap.update_map(40, 10, np.full((2, 2), 100, np.int8))
    costmap.update(0.1, IDENTITY)
    seen = costmap.snapshot()
    assert cost_at(4.1, 1.1) == LETHAL


@pytest.mark.parametrize("origin, shape, uses_maximum", [
    (Pose2D(1.0, -2.0, 0.3), (40, 40), True),  # zones drawn over a turned floor plan, as large as that
    (Pose2D(2.0, -1.0, 0.5), (4, 6), False),  # a part that was mapped anew, and lies askew
])
def test_a_turned_map_over_another_leaves_its_walls_standing(origin, shape, uses_maximum):
    costmap = build_costmap("costmap", {
        "plugins": [{"name": name, "type": "StaticLayer"} for name in ("floor", "over")],
        "over": {"use_maximum": uses_maximum}})
    floor, data = Pose2D(1.0, -2.0, 0.3), np.zeros((40, 40), np.int8)
    data[30, 10] = 100
    costmap.set_map(OccupancyMap(data, 0.1, floor), "floor")
    costmap.set_map(OccupancyMap(np.zeros(shape, np.int8), 0.1, origin), "over")
    costmap.update(0.0, IDENTITY)
    seen = costmap.snapshot()
    column, row = seen.grid.cell_at(*floor.transform_points(np.array([[1.05, 3.05]]))[0])
    assert seen.costs[row, column] == LETHAL


def test_a_map_too_large_to_be_turned_is_refused_with_its_angle():
    with pytest.raises(ValueError, match="0.78 rad, and upright it takes 22.* cells"):
        map_alone().set_map(OccupancyMap(np.zeros((1, 32000), np.int8), 0.1, Pose2D(0.0, 0.0, 0.78)))
