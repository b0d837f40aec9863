"""A PoseArray that is serialized from an array, since thousands of pose objects would take longer than the filter."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseArray


class ParticleCloud(PoseArray):
    """A geometry_msgs/PoseArray for publishing; on the wire it is the same.

    Attributes:
        particles: Shape (N, 3) as x, y (m), theta (rad).
    """

    def __init__(self, header: Any, particles: np.ndarray) -> None:
        super().__init__(header=header)
        self.particles = particles

    def serialize(self, buff: Any) -> None:
        """Write header, count and seven doubles a pose, as geometry_msgs/PoseArray does."""
        header, frame = self.header, self.header.frame_id.encode()
        buff.write(struct.pack("<3I", header.seq, header.stamp.secs, header.stamp.nsecs))
        buff.write(struct.pack(f"<I{len(frame)}s", len(frame), frame))
        values = np.zeros((len(self.particles), 7), dtype="<f8")
        values[:, :2] = self.particles[:, :2]
        values[:, 5] = np.sin(self.particles[:, 2] / 2.0)
        values[:, 6] = np.cos(self.particles[:, 2] / 2.0)
        buff.write(struct.pack("<I", len(values)))
        buff.write(values.tobytes())
