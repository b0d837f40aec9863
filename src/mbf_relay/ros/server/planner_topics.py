"""The planners' topics (plan and potential), as of navfn and global_planner, and their dynamic_reconfigure servers."""

from __future__ import annotations

from typing import Any, ClassVar, Dict, Iterable, Type

import numpy as np
import rospy
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Path as PathMessage
from sensor_msgs.msg import PointCloud2

from mbf_relay.costmap.cost_grid import CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.maps import UNKNOWN, OccupancyMap
from mbf_relay.navigation.registry import Registry
from mbf_relay.planning.path import Path
from mbf_relay.planning.planner import Planner, PotentialWatcher
from mbf_relay.ros.common import reconfigure
from mbf_relay.ros.common.clouds import cloud_message
from mbf_relay.ros.common.conversions import map_to_message, path_to_message

CLOUD_SCALE = 20.0
"""Height z (m) of the start in navfn's cloud; the other points are scaled in proportion to their potential."""


class PlanPublisher:
    """Publishes each planner's paths on ~NAME/plan while there are subscribers.

    Args:
        names: The planners' names.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self._publishers: Dict[str, rospy.Publisher] = {}
        for name in names:
            self.add(name)

    def add(self, name: str) -> None:
        """Advertise the topic of another planner."""
        self._publishers[name] = rospy.Publisher(f"~{name}/plan", PathMessage, queue_size=1)

    def publish(self, name: str, path: Path) -> None:
        """Publish a path that planner `name` found."""
        publisher = self._publishers[name]
        if publisher.get_num_connections():
            publisher.publish(path_to_message(path, rospy.get_rostime()))


class PotentialPublisher(PotentialWatcher):
    """Publishes a planner's potential on `~NAME/potential` if its parameter says so and there are subscribers."""

    message: ClassVar[Type[Any]]

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._publisher = rospy.Publisher(f"~{planner.name}/potential", self.message, queue_size=1)
        planner.potential_watcher = self

    def is_watching(self) -> bool:
        display = self._planner.potential_display
        return display is not None and display.wanted and self._publisher.get_num_connections() > 0


class PotentialCloud(PotentialPublisher):
    """As navfn does with visualize_potential: points x, y, z and pot."""

    message = PointCloud2

    def take(self, costmap: CostGrid, potential: np.ndarray, start: Pose2D) -> None:
        rows, columns = np.nonzero(potential)
        values = potential[rows, columns]
        column, row = costmap.grid.cell_at(start.x, start.y)
        points = np.empty((len(values), 4), dtype=np.float32)
        points[:, :2] = costmap.grid.centers_of(np.column_stack((columns, rows)))
        points[:, 2] = values / max(float(potential[row, column]), 1e-6) * CLOUD_SCALE
        points[:, 3] = values
        self._publisher.publish(cloud_message(("x", "y", "z", "pot"), points, costmap.frame, rospy.get_rostime()))


class PotentialGrid(PotentialPublisher):
    """As global_planner does with publish_potential: an occupancy grid."""

    message = OccupancyGrid

    def take(self, costmap: CostGrid, potential: np.ndarray, start: Pose2D) -> None:
        highest = max(float(potential.max()), 1e-6)
        assert self._planner.potential_display is not None
        scaled = (potential * (self._planner.potential_display.highest / highest)).astype(np.int8)
        values = np.where(potential > 0.0, scaled, np.int8(UNKNOWN))
        grid = costmap.grid
        occupancy = OccupancyMap(values, grid.resolution, Pose2D(grid.origin_x, grid.origin_y, 0.0))
        self._publisher.publish(map_to_message(occupancy, costmap.frame, rospy.get_rostime()))


PUBLISHERS: Dict[str, Type[PotentialPublisher]] = {"cloud": PotentialCloud, "grid": PotentialGrid}
"""Publisher by the form that a planner's `potential_display` names."""


def serve_planners(planners: Registry[Planner]) -> None:
    """Advertise the potentials and reconfigure servers of all planners."""
    for name in planners.names:
        serve_planner(planners, name)


def serve_planner(planners: Registry[Planner], name: str) -> None:
    """Advertise the potential and, where it has one, the reconfigure server of a planner."""
    planner = planners.plugin(name)
    if planner.potential_display is not None:
        PUBLISHERS[planner.potential_display.form](planner)
    reconfigure.serve_plugin(planners, name)
