"""Conversion and validation of messages for the layers of the page."""

from __future__ import annotations

import math
from typing import Any, Dict, List, Optional

import numpy as np
from geometry_msgs.msg import PolygonStamped, PoseArray
from nav_msgs.msg import Path
from sensor_msgs.msg import LaserScan, PointCloud2, PointField
from visualization_msgs.msg import Marker, MarkerArray

from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.conversions import pose_from_message, scan_from_message
from mbf_relay.view.tiles import GridShape

LARGEST_GRID = 1 << 26
"""Most cells of a grid (64 MiB), which a browser's memory can still hold."""
OUTLINE = 24
"""Corners of the polygon drawn for a round obstacle."""
SET_DOWN = "web_view"
"""Namespace of the markers of obstacles that were set from a browser."""


def grid_shape(message: Any) -> GridShape:
    """Return size, resolution (m), origin and frame of an OccupancyGrid.

    Raises:
        InvalidMessage: Its resolution or origin is invalid, or it has more than LARGEST_GRID cells.
    """
    info = message.info
    if info.width * info.height > LARGEST_GRID:
        raise InvalidMessage(f"grid of {info.width} x {info.height} cells; {LARGEST_GRID} can be shown")
    resolution = float(str(np.float32(info.resolution)))
    if not (math.isfinite(resolution) and resolution > 0.0):
        raise InvalidMessage(f"grid with cells of {info.resolution} m")
    return GridShape(
        info.width, info.height, resolution, pose_from_message(info.origin), message.header.frame_id.lstrip("/")
    )


def scan_points(message: LaserScan) -> np.ndarray:
    """Return the hit points of a scan, shape (N, 2) in metres, in the lidar's frame."""
    return scan_from_message(message).hit_points


def path_points(message: Path) -> np.ndarray:
    """Return a path's finite positions, shape (N, 2) in metres, in its frame."""
    positions = [(stamped.pose.position.x, stamped.pose.position.y) for stamped in message.poses]
    points = np.array(positions, dtype=float).reshape(-1, 2)
    finite: np.ndarray = points[np.isfinite(points).all(axis=1)]
    return finite


def particle_poses(message: PoseArray) -> np.ndarray:
    """Return particles as rows of x (m), y (m) and heading (rad), shape (N, 3), in their frame."""
    values = [(p.position.x, p.position.y, p.orientation.z, p.orientation.w) for p in message.poses]
    rows = np.array(values, dtype=float).reshape(-1, 4)
    sine, cosine = rows[:, 2].copy(), rows[:, 3].copy()
    return np.column_stack((rows[:, :2], np.arctan2(2.0 * sine * cosine, cosine ** 2 - sine ** 2)))


def polygon_points(message: PolygonStamped) -> np.ndarray:
    """Return a polygon's finite corners, shape (N, 2) in metres, in its frame."""
    points = np.array([(corner.x, corner.y) for corner in message.polygon.points], dtype=float).reshape(-1, 2)
    finite: np.ndarray = points[np.isfinite(points).all(axis=1)]
    return finite


def cloud_points(message: PointCloud2) -> np.ndarray:
    """Return a cloud's finite points as rows of x (m), y (m) and cost, scaled to [0, 1]; shape (N, 3).

    Raises:
        InvalidMessage: It has no little-endian float32 fields x, y and cost (or total_cost), or its data has another
            length than its size says.
    """
    offsets = {field.name: field.offset for field in message.fields if field.datatype == PointField.FLOAT32}
    names = ("x", "y", "cost" if "cost" in offsets else "total_cost")
    count = message.width * message.height
    if message.is_bigendian or not all(name in offsets for name in names):
        raise InvalidMessage("cloud without x, y and cost of 32 bits, the lowest byte first")
    if len(message.data) != count * message.point_step or any(offsets[name] + 4 > message.point_step for name in names):
        raise InvalidMessage(f"cloud of {count} points of {message.point_step} bytes with {len(message.data)} bytes")
    kind = np.dtype(
        {
            "names": names,
            "formats": ["<f4"] * 3,
            "offsets": [offsets[name] for name in names],
            "itemsize": message.point_step,
        }
    )
    records = np.frombuffer(bytes(message.data), dtype=kind)
    points = np.column_stack([records[name].astype(float) for name in names]) if count else np.empty((0, 3))
    points = points[np.isfinite(points).all(axis=1)]
    if len(points):
        low, high = points[:, 2].min(), points[:, 2].max()
        points[:, 2] = (points[:, 2] - low) / (high - low) if high > low else 0.0
    return points


def set_down(message: MarkerArray) -> List[int]:
    """Return the marker ids of the present obstacles that were set from a browser."""
    return [marker.id for marker in message.markers if marker.action == Marker.ADD and marker.ns == SET_DOWN]


def obstacle_outlines(message: MarkerArray, map_frame: str) -> List[List[List[float]]]:
    """Return the outlines of boxes, cylinders and spheres as lists of [x, y] (m) in `map_frame`; leave out others."""
    outlines: List[List[List[float]]] = []
    for marker in message.markers:
        if marker.action != Marker.ADD or marker.header.frame_id.lstrip("/") != map_frame:
            continue
        half_x, half_y = marker.scale.x / 2.0, marker.scale.y / 2.0
        if marker.type == Marker.CUBE:
            corners = np.array([(half_x, half_y), (-half_x, half_y), (-half_x, -half_y), (half_x, -half_y)])
        elif marker.type in (Marker.CYLINDER, Marker.SPHERE):
            turns = np.linspace(0.0, 2.0 * math.pi, OUTLINE, endpoint=False)
            corners = np.column_stack((half_x * np.cos(turns), half_y * np.sin(turns)))
        else:
            continue
        try:
            placed = pose_from_message(marker.pose).transform_points(corners)
        except InvalidMessage:
            continue
        if np.isfinite(placed).all():
            outlines.append(placed.round(3).tolist())
    return outlines


def short(text: str, longest: int) -> str:
    """Return a text on one line, cut to `longest` characters."""
    line = " ".join(str(text).split())
    return line if len(line) <= longest else line[:longest - 1] + "…"


def log_entry(message: Any) -> Optional[Dict[str, Any]]:
    """Return level, node and text of a rosgraph_msgs/Log for the page; None below the level of warnings."""
    if message.level < message.WARN:
        return None
    return {
        "level": "warn" if message.level == message.WARN else "error",
        "node": short(message.name, 60),
        "text": short(message.msg, 300),
    }
