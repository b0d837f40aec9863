"""Diagnostics of amcl: standard deviations and scans, and warnings where no scans come."""

from __future__ import annotations

import time
from typing import Callable, List, Mapping, Optional, Set, Tuple

import numpy as np
import rospy

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import DOUBTFUL
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.amcl.cloud_input import AnyScan
from mbf_relay.ros.common import diagnostics
from mbf_relay.ros.common.checks import shown
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.ros.common.message_queue import MessageQueue
from mbf_relay.ros.common.transforms import Transforms

SILENCE = 15.0
"""Wall seconds without a scan until a warning, and between two warnings."""
LATE = 2.0
"""Shortest time (s) without a scan that the diagnostics call an error; three scan periods if that is longer."""
MISDATED = 0.15
"""Offset (s) between the stamps of scans and odometry from which on there is a warning. A scan that takes 0.2 s and is
stamped at its end is 0.1 s late, which hardly affects localization."""


def deviation_report(
    values: AmclParameters, covariance: np.ndarray, details: Mapping[str, object]
) -> diagnostics.Report:
    """Return amcl's report of the estimate's deviations, from the covariance, shape (3, 3), and further details."""
    deviations = np.sqrt(np.diag(covariance))
    levels = (values.std_warn_level_x, values.std_warn_level_y, values.std_warn_level_yaw)
    report = {
        "std_x": deviations[0], "std_y": deviations[1], "std_yaw": deviations[2], "std_warn_level_x": levels[0],
        "std_warn_level_y": levels[1], "std_warn_level_yaw": levels[2], **details,
    }
    if (deviations > levels).any():
        return diagnostics.WARN, "Too large", report
    return diagnostics.OK, "OK", report


def missing_transform(transforms: Transforms, values: AmclParameters, message: AnyScan) -> str:
    """Return which transform a scan waits for, the lidar's on the robot or odometry's at its time, and why."""
    header = message.header
    try:
        transforms.lookup(values.base_frame_id, header.frame_id)
        transforms.lookup(values.odom_frame_id, values.base_frame_id, header.stamp.to_sec())
    except TransformError as error:
        return str(error)
    return "its transform has just come"


def stands_in_the_world(transforms: Transforms, values: AmclParameters, message: AnyScan) -> bool:
    """Return whether a scan's sensor does not move with the robot, and warn of it."""
    frame, base_frame = message.header.frame_id, values.base_frame_id
    if values.odom_frame_id.lstrip("/") not in transforms.frames_above(base_frame, frame):
        return False
    rospy.logwarn_throttle(5.0, f"scan ignored: its frame '{frame}' does not move with the robot ('{base_frame}'); "
                                "see the sensor's transform")
    return True


def misdated(frame: str, late: float) -> str:
    """Return the warning about a lidar whose scans are stamped `late` seconds late, or early if negative."""
    when = "later" if late > 0.0 else "earlier"
    return (
        f"scans of {shown(frame)} are dated {abs(late):.2f} s {when} than odometry, as both turn; that is set right "
        "here and in costmaps, and nowhere else: give the lidar's driver the offset, or have both computers follow one "
        "clock")


def misdated_lidars(timings: LidarTimings) -> List[Tuple[str, float]]:
    """Return the frames and offsets (s) of the lidars whose stamps differ from odometry's by MISDATED or more."""
    late = [(frame, timing.late or 0.0) for frame, timing in sorted(timings.all().items())]
    return [each for each in late if abs(each[1]) >= MISDATED]


class ScanWatch:
    """Watches whether scans are used; warns where none are for long, with what is missing."""

    def __init__(self) -> None:
        self._last = time.monotonic()
        self._scans = diagnostics.RateMeter()
        self._warned_of: Set[str] = set()  # frames of lidars whose stamps were warned of
        self._jumps = 0  # number of odometry's jumps warned of
        self._searched = 1.0  # share last warned of

    def saw(self, now: float) -> None:
        """Record that a scan is processed at `now` (s, ROS time)."""
        self._scans.tick(now)

    def worked(self) -> None:
        """Record that a scan has been processed; scans that came meanwhile waited only for that."""
        self._last = time.monotonic()

    def warn_of_jumps(self, jumps: int, odom_pose: Pose2D) -> None:
        """Warn, once per jump, that odometry has started over at `odom_pose`; `jumps` is their number so far."""
        if jumps > self._jumps:
            rospy.logwarn(
                "odometry has jumped to x %.2f, y %.2f, yaw %.2f, farther than the robot can have driven since the "
                "last scan, and the scan still fits the pose before: odometry began anew, and the pose is kept",
                *odom_pose)
        self._jumps = jumps

    def warn_of_search(self, searched: float) -> None:
        """Warn if a search of the whole map could only examine a share, 0 to 1, of the candidate places."""
        if searched < 1.0 and searched != self._searched:
            rospy.logwarn(
                "too much of the map looks like the scan to search it all: %.1f %% was looked at, and the robot may be "
                "elsewhere; give an initial pose, or search again where the robot sees more",
                100.0 * searched)
        self._searched = searched

    def warn_of_dates(self, timings: LidarTimings) -> None:
        """Warn, once per lidar, of stamps that differ from odometry's."""
        for frame, late in misdated_lidars(timings):
            if frame not in self._warned_of:
                self._warned_of.add(frame)
                rospy.logwarn("%s", misdated(frame, late))

    def report(
        self, now: float, has_map: bool, match: Optional[float], waiting: bool, timings: LidarTimings,
    ) -> diagnostics.Report:
        """Return the part of the diagnostics about scans.

        Args:
            now: ROS time (s).
            has_map: Whether there is a map.
            match: Share of the newest scan, 0 to 1, that the map explains from the estimated pose; None where unknown.
            waiting: Whether a scan waits for its transform.
            timings: Of the lidars.
        """
        age, rate = self._scans.age(now), self._scans.rate()
        values = {
            "scans [Hz]": f"{rate:.1f}", "age of the last scan [s]": "none came" if age is None else f"{age:.2f}",
            "scan waits for its transform": waiting,
            "share of the scan on the map's walls [%]": "unknown" if match is None else f"{100.0 * match:.0f}",
            **timings.values(),
        }
        told = [misdated(frame, late) for frame, late in misdated_lidars(timings)]
        patience = max(LATE, 3.0 / rate if rate > 0.0 else 0.0)
        if not has_map:
            return diagnostics.ERROR, "no map yet", values
        if age is None or age > patience:
            since = "yet" if age is None else f"for {age:.1f} s"
            why = "the transform at its time is missing" if waiting else "none comes"
            return diagnostics.ERROR, f"no scan {since}: {why}", values
        if told:
            return diagnostics.WARN, "; ".join(told), values
        if match is not None and match < DOUBTFUL:
            return (
                diagnostics.WARN,
                f"only {100.0 * match:.0f} % of the scan lies on the map's walls; is the pose right?",
                values,
            )
        return diagnostics.OK, "scans are used", values

    def warn_of_silence(self, queue: MessageQueue, why: Callable[[AnyScan], str]) -> None:
        """Warn if no scan was processed for SILENCE; call it often.

        Args:
            queue: The queue of waiting scans.
            why: Returns what a scan waits for.
        """
        silence = time.monotonic() - self._last
        if silence < SILENCE:
            return
        waiting, topic = queue.oldest(), rospy.resolve_name("scan")
        if waiting is None:
            rospy.logwarn_throttle(
                SILENCE, f"no scan on {topic} for {silence:.0f} s, so no pose comes: see the lidar and the topic name")
        else:
            rospy.logwarn_throttle(SILENCE, f"scans on {topic} wait for {silence:.0f} s: {why(waiting)}")
