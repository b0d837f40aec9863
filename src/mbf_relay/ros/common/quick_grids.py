"""Grid messages that write and read their cells as one block; rospy handles each cell as a Python number.

Serialized they are the same as the messages they derive from. A map of 15 million cells takes milliseconds instead of
seconds.
"""

from __future__ import annotations

import copy
import io
import struct
from typing import Any, Optional

import numpy as np
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid

_LENGTH = struct.Struct("<I")


class _QuickCells:
    """Writes and reads `data`, the last field, as a block of bytes; it is an int8 array, or a sequence of numbers."""

    data: Any
    _after_header: int

    def serialize(self, buff: Any) -> None:
        """Write the message to a buffer."""
        cells = np.asarray(self.data, dtype=np.int8)
        rest = io.BytesIO()
        without = copy.copy(self)  # a latched message may be written by several threads at once
        without.data = ()
        super(_QuickCells, without).serialize(rest)  # type: ignore[misc]
        buff.write(rest.getvalue()[:-_LENGTH.size])
        buff.write(_LENGTH.pack(cells.size))
        buff.write(cells.tobytes())

    def deserialize(self, text: bytes) -> Any:
        """Fill the message from bytes and return it."""
        begin = self._cells_begin(text)
        if begin is None:
            return super().deserialize(text)  # type: ignore[misc]
        super().deserialize(text[:begin - _LENGTH.size] + _LENGTH.pack(0))  # type: ignore[misc]
        self.data = np.frombuffer(text, dtype=np.int8, offset=begin)
        return self

    def _cells_begin(self, text: bytes) -> Optional[int]:
        """Return the offset of the cells, None where their number does not fit the message's length."""
        fixed = self._fixed_size(text)
        if len(text) < fixed + _LENGTH.size:
            return None
        (count,) = _LENGTH.unpack_from(text, fixed)
        return fixed + _LENGTH.size if fixed + _LENGTH.size + count == len(text) else None

    def _fixed_size(self, text: bytes) -> int:
        """Return the offset of the number of cells: after the header with its frame_id, and fields of fixed size."""
        (name,) = _LENGTH.unpack_from(text, 12)
        return 16 + int(name) + self._after_header


class QuickGrid(_QuickCells, OccupancyGrid):
    """nav_msgs/OccupancyGrid with its cells as an int8 array."""

    _after_header = 8 + 4 + 4 + 4 + 7 * 8  # map_load_time, resolution, width, height, origin


class QuickGridUpdate(_QuickCells, OccupancyGridUpdate):
    """map_msgs/OccupancyGridUpdate with its cells as an int8 array."""

    _after_header = 4 * 4  # x, y, width, height
