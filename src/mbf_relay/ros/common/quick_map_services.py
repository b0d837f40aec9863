"""Services that answer with a map, with its cells written and read as one block.

rospy makes a Python object of forty bytes of each cell: an answer of `static_map` with 64 million cells took 2.6 GiB.
"""

from __future__ import annotations

import struct
from typing import Any

from nav_msgs.srv import GetMap, GetMapResponse, LoadMapResponse

from mbf_relay.ros.common.quick_grids import QuickGrid


class QuickMapResponse(GetMapResponse):
    """The answer of nav_msgs/GetMap, with a QuickGrid."""

    def serialize(self, buff: Any) -> None:
        """Write the message to a buffer."""
        self.map.serialize(buff)

    def deserialize(self, text: bytes) -> Any:
        """Fill the message from bytes and return it."""
        self.map = QuickGrid().deserialize(text)
        return self


class QuickGetMap(GetMap):
    """nav_msgs/GetMap, for clients."""

    _response_class = QuickMapResponse


class QuickLoadResponse(LoadMapResponse):
    """The answer of nav_msgs/LoadMap, with a QuickGrid, for servers."""

    def serialize(self, buff: Any) -> None:
        """Write the message to a buffer."""
        self.map.serialize(buff)
        buff.write(struct.pack("<B", self.result))
