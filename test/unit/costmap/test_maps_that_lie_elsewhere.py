"""Maps that do not lie along the costmap's cells are laid on them where they belong."""

import numpy as np

from mbf_relay.costmap.cost_grid import LETHAL
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
