"""PointCloud2 without a copy of its data: rospy copies the megabytes of a depth camera once more for each message."""

from __future__ import annotations

import struct
from typing import Any, Optional

import numpy as np
from sensor_msgs.msg import PointCloud2

_LENGTH = struct.Struct("<I")
_BEFORE_NAME, _SIZES, _OF_FIELD, _LAYOUT, _AFTER_DATA = 12, 8, 9, 9, 1
"""Bytes before frame_id (seq, stamp); of height and width; of a field's offset, datatype and count; of is_bigendian,
point_step and row_step; of is_dense."""


class QuickCloud(PointCloud2):
    """sensor_msgs/PointCloud2 for subscribers: `data` is a memoryview of the received bytes."""

    @staticmethod
    def make_room(length: int) -> np.ndarray:
        """Return a buffer of `length` bytes for a message, uninitialized; see rospy_patches.receiving."""
        return np.empty(length, np.uint8)

    def deserialize(self, text: Any) -> Any:
        """Fill the message from bytes, or a view of them, and return it."""
        begin = _data_begin(text)
        if begin is None:
            return super().deserialize(bytes(text))
        end = len(text) - _AFTER_DATA
        super().deserialize(bytes(text[:begin - _LENGTH.size]) + _LENGTH.pack(0) + bytes(text[end:]))
        self.data = memoryview(text)[begin:end]
        return self


def _data_begin(text: Any) -> Optional[int]:
    """Return the offset of `data` in a serialized message, None where the lengths before it do not fit the message."""
    try:
        (name,) = _LENGTH.unpack_from(text, _BEFORE_NAME)
        at = _BEFORE_NAME + _LENGTH.size + int(name) + _SIZES
        (fields,) = _LENGTH.unpack_from(text, at)
        at += _LENGTH.size
        for _ in range(fields):
            (name,) = _LENGTH.unpack_from(text, at)
            at += _LENGTH.size + int(name) + _OF_FIELD
        at += _LAYOUT
        (size,) = _LENGTH.unpack_from(text, at)
    except struct.error:
        return None
    at += _LENGTH.size
    return at if at + size + _AFTER_DATA == len(text) else None
