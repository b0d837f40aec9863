"""What the amcl node says of its health: deviations among the diagnostics, and warnings where no scan comes."""

from __future__ import annotations

import time
from typing import Mapping

import numpy as np
import rospy

from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.ros import diagnostics
from mbf_relay.ros.scan_queue import ScanQueue

SILENCE = 15.0
"""Wall seconds without a scan that are worth a warning, and from one warning to the next."""


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


class ScanWatch:
    """Warns where no scan could be used for long, and tells what is missing."""

    def __init__(self) -> None:
        self._last = time.monotonic()

    def saw(self) -> None:
        """Note that a scan came through."""
        self._last = time.monotonic()

    def look(self, queue: ScanQueue, values: AmclParameters) -> None:
        """Warn where it is time to; call it often."""
        silence = time.monotonic() - self._last
        if silence < SILENCE:
            return
        waiting, topic = queue.oldest(), rospy.resolve_name("scan")
        if waiting is None:
            rospy.logwarn_throttle(SILENCE, f"no scan on {topic} for {silence:.0f} s; no pose comes without")
        else:
            rospy.logwarn_throttle(
                SILENCE,
                f"scans on {topic} wait for {silence:.0f} s: no transform from '{waiting.header.frame_id}' by "
                f"'{values.base_frame_id}' to '{values.odom_frame_id}' at their time",
            )
