"""Time offset and beam order of each lidar of a node (see ScanTiming), estimated with poses from tf."""

from __future__ import annotations

import threading
from typing import Callable, Dict, Optional, Tuple

from mbf_relay.geometry import Pose2D
from mbf_relay.ros.common.checks import shown
from mbf_relay.ros.common.lidar_geometry import mounting_of, placed_when
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.scan import LaserScan
from mbf_relay.scan_timing import ScanTiming


class LidarTimings:
    """Corrects scans for the times at which their beams were measured, estimated for each lidar; see ScanTiming.

    Any thread may use it; two costmaps share one.

    Args:
        transforms: The tf buffer.
        frames: Returns the robot's base frame, and a frame in which it moves without jumps (odom).
    """

    def __init__(self, transforms: Transforms, frames: Callable[[], Tuple[str, str]]) -> None:
        self._transforms, self._frames = transforms, frames
        self._timings: Dict[str, ScanTiming] = {}  # by frame
        self._lock = threading.Lock()  # guards all timings

    def corrected(self, scan: LaserScan, laser_in_base: Optional[Pose2D] = None) -> LaserScan:
        """Update the estimate with a scan and return the scan corrected, with its stamp on odometry's time.

        Args:
            scan: With angles counter-clockwise seen from above.
            laser_in_base: The pose its angles refer to, where that is not the lidar's frame by tf, in the base frame.
        """
        base_frame, odom_frame = self._frames()

        def pose_at(time: float) -> Pose2D:
            if laser_in_base is None:
                return mounting_of(self._transforms.lookup_message(odom_frame, scan.frame, time).transform)[0]
            return self._transforms.lookup(odom_frame, base_frame, time).compose(laser_in_base)

        def pose_known(time: float) -> Pose2D:
            """Return what `pose_at` does; uses the newest pose of a lidar that moves on the robot, if tf lags there."""
            if laser_in_base is not None:
                return pose_at(time)
            placed, _ = placed_when(time, scan.frame, base_frame, self._transforms)
            return self._transforms.lookup(odom_frame, base_frame, time).compose(mounting_of(placed.transform)[0])

        with self._lock:
            timing = self._timings.setdefault(scan.frame, ScanTiming())
            corrected = timing.corrected(scan, pose_known)  # by what `taken_at` told
            timing.take(scan, pose_at)
            return corrected

    def taken_at(self, frame: str, stamp: float) -> float:
        """Return the time (s), by odometry's stamps, at which the lidar of `frame` measured what it stamps so (s)."""
        timing = self._timings.get(frame)
        return stamp - (timing.late or 0.0) if timing else stamp

    def values(self) -> Dict[str, str]:
        """Return what is known of each lidar, for diagnostics."""
        told: Dict[str, str] = {}
        for frame, timing in sorted(self.all().items()):
            late, order = timing.late, timing.order
            told[f"scans of {shown(frame)} are dated late by [s]"] = "unknown" if late is None else f"{late:.2f}"
            told[f"beams of {shown(frame)} are taken"] = "unknown" if order is None else str(order)
        return told

    def all(self) -> Dict[str, ScanTiming]:
        """Return the timings by the lidars' frames."""
        with self._lock:
            return dict(self._timings)
