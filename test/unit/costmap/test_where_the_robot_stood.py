"""What a robot stood on is free as long as it stands there, and what was seen there stands again when it has left."""

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.observation import Observation, observation_from_scan
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.scan import LaserScan


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


@pytest.mark.parametrize("persistence", [0.0, 0.5])
def test_a_robot_plans_by_all_that_its_lidar_saw_however_seldom_that_looks(persistence):
    """What it saw is drawn once; the costmap shows what it would were it drawn anew every time, as costmap_2d does."""
    for seed in range(10):
        drawn, redrawn = (build_costmap("costmap", {
            "width": 5.0, "height": 5.0, "origin_x": -2.5, "origin_y": -2.5, "resolution": 0.05, "robot_radius": 0.25,
            "plugins": [{"name": name, "type": f"{name}Layer"} for name in ("Obstacle", "Inflation")],
            "Obstacle": {"observation_sources": "scan", "scan": {
                "data_type": "LaserScan", "clearing": True, "observation_persistence": persistence}},
        }) for _ in range(2))
        rng, pose = np.random.default_rng(seed), IDENTITY
        for step in range(30):
            now, pose = 0.2 * step, pose.compose(Pose2D(*rng.normal(0.0, (0.2, 0.05, 0.3))))
            if step % 3 == 0:
                scan = LaserScan(rng.uniform(0.15, 3.0, 60), 0.0, 2.0 * np.pi / 60, 0.1, 3.5, now)
                for costmap in (drawn, redrawn):
                    costmap.observe("scan", observation_from_scan(scan, pose), now)
            redrawn.clear(["Obstacle"], around=Pose2D(1e3, 1e3, 0.0), side=1.0)  # of nothing: it draws all anew
            for costmap in (drawn, redrawn):
                costmap.update(now, pose)
            assert (drawn.snapshot().costs == redrawn.snapshot().costs).all(), f"seed {seed}, step {step}"
