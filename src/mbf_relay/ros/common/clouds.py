"""Conversions between PointCloud2 messages and arrays, and of transforms to a rotation matrix and a translation."""

from __future__ import annotations

from typing import Any, Sequence, Tuple

import numpy as np
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import PointCloud2, PointField

from mbf_relay.ros.common import checks
from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.conversions import header

FLOATS = {PointField.FLOAT32: "f4", PointField.FLOAT64: "f8"}
"""NumPy's format of each type that a coordinate may have."""


def rigid(message: TransformStamped) -> Tuple[np.ndarray, np.ndarray]:
    """Return a transform as a rotation matrix (3, 3) and a translation (3,) in metres."""
    q, t = message.transform.rotation, message.transform.translation
    x, y, z, w = q.x, q.y, q.z, q.w
    rotation = np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ])
    return rotation, np.array([t.x, t.y, t.z])


def cloud_message(names: Sequence[str], points: np.ndarray, frame: str, stamp: Any) -> PointCloud2:
    """Return an unorganized cloud (height 1) of float32 fields.

    Args:
        names: Names of the fields.
        points: Their values, shape (M, len(names)).
        frame: Frame of the points.
        stamp: In seconds or as rospy.Time.
    """
    fields = [PointField(name, 4 * index, PointField.FLOAT32, 1) for index, name in enumerate(names)]
    return PointCloud2(
        header=header(frame, stamp), height=1, width=len(points), fields=fields, is_bigendian=False,
        point_step=4 * len(names), row_step=4 * len(names) * len(points), is_dense=True,
        data=points.astype(np.float32).tobytes(),
    )


def cloud_points(message: PointCloud2) -> np.ndarray:
    """Return the x, y and z of a point cloud, shape (N, 3) in metres; rows with NaN stay.

    Raises:
        InvalidMessage: A coordinate is missing, is no float, or the data is shorter than its size says.
    """
    fields = {field.name: field for field in message.fields}
    missing = [name for name in "xyz" if name not in fields]
    if missing:
        raise InvalidMessage(f"point cloud without field {', '.join(missing)}; it has {', '.join(fields) or 'none'}")
    order = ">" if message.is_bigendian else "<"
    formats = []
    for name in "xyz":
        if fields[name].datatype not in FLOATS:
            raise InvalidMessage(f"field {name} of a point cloud has type {fields[name].datatype}; it must be a float")
        formats.append(order + FLOATS[fields[name].datatype])
    checks.check_cloud(message)
    shape, strides = (message.height, message.width), (checks.row_step(message), message.point_step)
    points = np.empty((message.height * message.width, 3))
    if points.size:  # numpy 1.17 has no array of 0 rows of 2^32 - 1 points
        rows = points.reshape(*shape, 3)
        for column, (name, kind) in enumerate(zip("xyz", formats)):
            rows[..., column] = np.ndarray(shape, kind, message.data, fields[name].offset, strides)
    return points
