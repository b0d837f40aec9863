"""Topics of a costmap: the whole of it for new subscribers, then its changes, and the robot's footprint."""

from __future__ import annotations

import sys
import threading
from typing import Any, Callable, Optional

import numpy as np
import rospy
from geometry_msgs.msg import Point32, Polygon, PolygonStamped
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid

from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, NO_INFORMATION, CostGrid, Window
from mbf_relay.geometry import Pose2D
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.common.conversions import header, map_to_message
from mbf_relay.ros.common.quick_grids import QuickGridUpdate


def occupancy_table() -> np.ndarray:
    """Return the occupancy costmap_2d publishes for each cost, shape (256,), int8: 1 to 98 for costs 1 to 252."""
    costs = np.arange(256)
    table = (1 + 97 * (costs - 1) // 251).astype(np.int8)
    table[0], table[INSCRIBED], table[LETHAL], table[NO_INFORMATION] = 0, 99, 100, -1
    return table


OCCUPANCY = occupancy_table()
"""Occupancy by cost; see `occupancy_table`."""


class CostmapPublisher:
    """Publishes one costmap under `~NAME/`, as costmap_2d does; without subscribers nothing is converted."""

    def __init__(
        self, name: str, footprint_topic: str, always_full: bool, latest: Callable[[], Optional[CostGrid]]
    ) -> None:
        """Advertise.

        Args:
            name: The costmap's name.
            footprint_topic: Name of the footprint's topic, relative to the costmap's.
            always_full: Whether to send the whole costmap each time.
            latest: Returns the present costmap, None before its first update; called from rospy's threads for new
                subscribers, also where publish_frequency is 0.
        """
        self._always_full, self._latest = always_full, latest
        self._sent: Optional[CostGrid] = None
        self._lock = threading.Lock()  # guards what follows; nothing else is locked while it is held
        self._greeted_with = sys.maxsize  # oldest revision sent to a new subscriber since the last publication
        self._updates = rospy.Publisher(f"~{name}/costmap_updates", OccupancyGridUpdate, queue_size=10)
        self._costmap = rospy.Publisher(
            f"~{name}/costmap", OccupancyGrid, subscriber_listener=_Greeter(self._greet), queue_size=1)
        self._footprint = rospy.Publisher(f"~{name}/{footprint_topic}", PolygonStamped, queue_size=1)

    @property
    def footprint_topic(self) -> str:
        """Resolved name of the footprint's topic."""
        return str(self._footprint.resolved_name)

    def _greet(self, publish: Any) -> None:
        latest = self._latest()
        if latest is None:
            return
        publish(grid_message(latest))
        with self._lock:  # updates published while the new subscriber waited for the whole grid were lost on it
            self._greeted_with = min(self._greeted_with, latest.revision)

    def publish(self, snapshot: CostGrid) -> None:
        """Send what changed since the last call, or everything where the grid itself has changed.

        The changes begin at the revision that new subscribers got meanwhile, if that is older.
        """
        if self._costmap.get_num_connections() + self._updates.get_num_connections() == 0:
            self._sent = None
            return
        with self._lock:
            greeted_with, self._greeted_with = self._greeted_with, sys.maxsize
        before, self._sent = self._sent, snapshot
        changed = None
        if before is not None and before.grid == snapshot.grid and not self._always_full:
            changed = snapshot.changed_since(min(before.revision, greeted_with))
        if changed is None:
            self._costmap.publish(grid_message(snapshot))
        elif not changed.is_empty:
            self._updates.publish(update_message(snapshot, changed))

    def publish_footprint(self, corners: np.ndarray, frame: str, stamp: Any) -> None:
        """Send the outline where the robot stands: (K, 2) in metres, in `frame`."""
        if self._footprint.get_num_connections():
            polygon = Polygon([Point32(x, y, 0.0) for x, y in corners])
            self._footprint.publish(PolygonStamped(header(frame, stamp), polygon))


class _Greeter(rospy.SubscribeListener):
    """Sends every new subscriber the whole costmap, to it alone."""

    def __init__(self, greet: Any) -> None:
        super().__init__()
        self._greet = greet

    def peer_subscribe(self, _topic: str, _publish: Any, peer_publish: Any) -> None:
        self._greet(peer_publish)


def grid_message(snapshot: CostGrid) -> OccupancyGrid:
    """Return a whole costmap as a message."""
    grid = snapshot.grid
    occupancy = OccupancyMap(OCCUPANCY[snapshot.costs], grid.resolution, Pose2D(grid.origin_x, grid.origin_y, 0.0))
    return map_to_message(occupancy, snapshot.frame, snapshot.stamp)


def update_message(snapshot: CostGrid, window: Window) -> OccupancyGridUpdate:
    """Return a window of a costmap as a message."""
    values = OCCUPANCY[snapshot.costs[window.slices]].ravel()
    return QuickGridUpdate(
        header(snapshot.frame, snapshot.stamp),
        window.x0,
        window.y0,
        window.x1 - window.x0,
        window.y1 - window.y0,
        values,
    )
