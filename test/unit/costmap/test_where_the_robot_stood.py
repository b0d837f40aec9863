"""What a robot stood on is free as long as it stands there, and what was seen there stands again when it has left."""

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.observation import Observation
from mbf_relay.geometry import Pose2D


@pytest.mark.parametrize("rolling", [False, True])
@pytest.mark.parametrize("kind", ["ObstacleLayer", "VoxelLayer"])
def test_what_a_camera_sees_stands_again_when_the_robot_that_brushed_it_has_left(kind, rolling):
    """Until the camera's next picture it was gone from the costmap, and for good where no ray of that passed by."""
    costmap = build_costmap("costmap", {
        "rolling_window": rolling, "width": 4.0, "height": 4.0, "origin_x": -2.0, "origin_y": -2.0, "resolution": 0.05,
        "robot_radius": 0.2, "plugins": [{"name": "obstacles", "type": kind}],
        "obstacles": {"observation_sources": "camera", "camera": {"data_type": "PointCloud2"}}})

    def cost_at(x, y):
        seen = costmap.snapshot()
        column, row = seen.grid.cell_at(x, y)
        return seen.costs[row, column]

    seen = np.array([[0.425, 0.025, 0.2], [0.425, 0.525, 0.2]])
    costmap.observe("camera", Observation((-0.5, 0.0, 0.3), seen, None, 1.0))
    for now, x, cost in ((1.0, 0.0, LETHAL), (1.2, 0.4, FREE_SPACE), (1.4, 0.41, FREE_SPACE), (1.6, 0.8, LETHAL)):
        costmap.update(now, Pose2D(x, 0.0, 0.0))
        assert (cost_at(0.425, 0.025), cost_at(0.425, 0.525)) == (cost, LETHAL), f"where the robot is at {x} m"
