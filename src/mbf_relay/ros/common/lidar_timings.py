"""The timing of each lidar of a node, with the poses of its frame by tf."""

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
    """Sets scans right by when their beams were taken, as it learns it of each lidar; see ScanTiming.

    Any thread may use it; two costmaps share one.

    Args:
        transforms: Where frames are looked up.
        frames: Gives the robot's frame, and one in which it moves without jumps.
    """

    def __init__(self, transforms: Transforms, frames: Callable[[], Tuple[str, str]]) -> None:
        self._transforms, self._frames = transforms, frames
        self._timings: Dict[str, ScanTiming] = {}  # by frame
        self._lock = threading.Lock()  # guards all timings

    def corrected(self, scan: LaserScan, laser_in_base: Optional[Pose2D] = None) -> LaserScan:
        """Learn from a scan, seen from above, and return it set right, dated by odometry's time.

        `laser_in_base` is for what was made to look along the base's axes; a lidar's own frame may turn on the robot.
        """
        base_frame, odom_frame = self._frames()

        def pose_at(time: float) -> Pose2D:
            if laser_in_base is None:
                return mounting_of(self._transforms.lookup_message(odom_frame, scan.frame, time).transform)[0]
            return self._transforms.lookup(odom_frame, base_frame, time).compose(laser_in_base)

        def pose_known(time: float) -> Pose2D:
            """Return what `pose_at` does, also where tf tells of a moving lidar later than of the robot."""
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
        """Return when, by odometry's time, a lidar took what it dates so (s)."""
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
