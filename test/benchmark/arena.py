"""The arena's costmap, as the server of a burger sees it, at the size of its map or scaled up: what benchmarks plan on.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Dict, Optional, Tuple

import numpy as np
import yaml

from mbf_relay.costmap import factory
from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.maps import OccupancyMap, load_map

START = Pose2D(-2.0, -0.5, 0.0)
GOAL = Pose2D(1.87, 0.38, 0.0)


def arena_map() -> OccupancyMap:
    """Return the map of the arena the package comes with."""
    return load_map(str(config_folder() / "maps" / "turtlebot3_world.yaml"))


def server_parameters() -> Dict[str, Any]:
    """Return the parameters of the server as the package configures it."""
    return yaml.safe_load((config_folder() / "move_base_flex.yaml").read_text(encoding="utf-8"))


def arena_costmap(scale: int = 1, obstacle: Optional[Tuple[float, float]] = None) -> CostGrid:
    """Return the arena's global costmap, inflated, each cell repeated `scale` times each way.

    Args:
        scale: Cells that stand for one of the map, each way.
        obstacle: Where in the map (m) something 0.1 m wide stands that the map as it is does not have.
    """
    parameters = server_parameters()
    costmap = factory.build_costmap("global_costmap", parameters["global_costmap"], parameters)
    costmap.set_map(arena_map() if obstacle is None else _with_obstacle(arena_map(), obstacle))
    costmap.update(0.0, START)
    snapshot = costmap.snapshot()
    grid = snapshot.grid
    costs = np.ascontiguousarray(np.repeat(np.repeat(snapshot.costs, scale, axis=0), scale, axis=1))
    scaled = Grid(grid.resolution / scale, grid.origin_x, grid.origin_y, grid.width * scale, grid.height * scale)
    return dataclasses.replace(snapshot, grid=scaled, costs=costs, history=())


def _with_obstacle(occupancy: OccupancyMap, place: Tuple[float, float]) -> OccupancyMap:
    local = Pose2D(*place, 0.0).relative_to(occupancy.origin)
    column, row = occupancy.local_grid.cell_at(local.x, local.y)
    data = occupancy.data.copy()
    data[row - 1:row + 1, column - 1:column + 1] = 100
    return dataclasses.replace(occupancy, data=data)
