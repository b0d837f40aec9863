"""Point clouds that are read from where they lie: rospy copies the megabytes of a depth camera's once more for each."""

from __future__ import annotations

import struct
from typing import Any, Optional

import numpy as np
from sensor_msgs.msg import PointCloud2

_LENGTH = struct.Struct("<I")
_BEFORE_NAME, _SIZES, _OF_FIELD, _LAYOUT, _AFTER_DATA = 12, 8, 9, 9, 1
"""Bytes of seq and stamp; height and width; offset, datatype and count of a field; order and steps; is_dense."""


class QuickCloud(PointCloud2):
    """sensor_msgs/PointCloud2 as it comes in: `data` is a view of what was received."""

    @staticmethod
    def make_room(length: int) -> np.ndarray:
        """Return room for so many bytes to come, which are not set to zero before, nor handed out page by page."""
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
    """Return where the points begin, None where what is told before them does not fit the message."""
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
