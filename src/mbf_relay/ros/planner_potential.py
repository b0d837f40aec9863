"""The planners' potentials on topics, and global_planner's parameters at run time."""

from __future__ import annotations

from typing import Any, List

import numpy as np
import rospy
from nav_msgs.msg import OccupancyGrid
from sensor_msgs.msg import PointCloud2, PointField

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.maps import UNKNOWN, OccupancyMap
from mbf_relay.navigation.registry import Registry
from mbf_relay.planning.global_planner import GlobalPlanner, GlobalPlannerParameters
from mbf_relay.planning.grid_planner import GridPlanner, PotentialWatcher
from mbf_relay.planning.planner import Planner
from mbf_relay.ros import reconfigure
from mbf_relay.ros.conversions import header, map_to_message

CLOUD_SCALE = 20.0
"""Height (m) of the start's point in navfn's cloud, by which the others are scaled."""


class PotentialCloud(PotentialWatcher):
    """Publishes `~NAME/potential` as navfn does with visualize_potential: points x, y, z and pot."""

    def __init__(self, planner: GridPlanner) -> None:
        self._planner = planner
        self._publisher = rospy.Publisher(f"~{planner.name}/potential", PointCloud2, queue_size=1)
        planner.potential_watcher = self

    def is_watching(self) -> bool:
        return self._planner.parameters.visualize_potential and self._publisher.get_num_connections() > 0

    def take(self, costmap: CostGrid, potential: np.ndarray, start: Pose2D) -> None:
        rows, columns = np.nonzero(potential)
        values = potential[rows, columns]
        column, row = costmap.grid.cell_at(start.x, start.y)
        points = np.empty((len(values), 4), dtype=np.float32)
        points[:, :2] = costmap.grid.centers_of(np.column_stack((columns, rows)))
        points[:, 2] = values / max(float(potential[row, column]), 1e-6) * CLOUD_SCALE
        points[:, 3] = values
        fields = [PointField(name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(("x", "y", "z", "pot"))]
        self._publisher.publish(PointCloud2(
            header(costmap.frame, rospy.get_rostime()), 1, len(points), fields, False, 16, 16 * len(points),
            points.tobytes(), True))


class PotentialGrid(PotentialWatcher):
    """Publishes `~NAME/potential` as global_planner does with publish_potential: an occupancy grid."""

    def __init__(self, planner: GlobalPlanner) -> None:
        self._planner = planner
        self._publisher = rospy.Publisher(f"~{planner.name}/potential", OccupancyGrid, queue_size=1)
        planner.potential_watcher = self

    def is_watching(self) -> bool:
        return self._planner.parameters.publish_potential and self._publisher.get_num_connections() > 0

    def take(self, costmap: CostGrid, potential: np.ndarray, start: Pose2D) -> None:
        highest = max(float(potential.max()), 1e-6)
        scaled = (potential * (self._planner.parameters.publish_scale / highest)).astype(np.int8)
        values = np.where(potential > 0.0, scaled, np.int8(UNKNOWN))
        grid = costmap.grid
        occupancy = OccupancyMap(values, grid.resolution, Pose2D(grid.origin_x, grid.origin_y, 0.0))
        self._publisher.publish(map_to_message(occupancy, costmap.frame, rospy.get_rostime()))


def serve_planners(planners: "Registry[Planner]") -> List[Any]:
    """Give planners their potential's topic and, where it has global_planner's parameters, its reconfigure server."""
    from mbf_relay.cfg import GlobalPlannerConfig

    served: List[Any] = []
    for name in planners.names:
        planner = planners.plugin(name)
        if isinstance(planner, GlobalPlanner):
            served.append(PotentialGrid(planner))
        elif isinstance(planner, GridPlanner) and hasattr(planner.parameters, "visualize_potential"):
            served.append(PotentialCloud(planner))
        if isinstance(planner.parameters, GlobalPlannerParameters):
            served.append(reconfigure.serve(GlobalPlannerConfig, planner.parameters, _setter(planners, name), namespace=name))
    return served


def _setter(planners: "Registry[Planner]", name: str) -> Any:
    return lambda parameters: planners.reconfigure(name, parameters)
