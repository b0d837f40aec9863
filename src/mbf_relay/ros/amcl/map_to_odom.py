"""The transform map -> odom: sent ahead of time at every scan, and repeated while no scans come."""

from __future__ import annotations

import threading
from collections import deque
from typing import Deque, Optional

import rospy

from mbf_relay.geometry import Pose2D
from mbf_relay.ros.common.transforms import TransformPublisher

SHORTEST_LOOK, LONGEST_LOOK = 0.02, 0.1
"""Bounds (wall s) of the time between two checks whether to repeat it."""
SIMULATED_SHARE = 0.25
"""Share of the time until it is due after which to check in simulated time, which may outrun the wall clock."""
REMEMBERED = 50
"""Number of recent stamps that are not used again."""
PAUSE = 0.3
"""Time (s) without a scan after which the transform is repeated."""


class MapToOdom:
    """Sends map -> odom, stamped ahead of the scan by the tolerance, for lookups until the next scan.

    A thread on the wall clock repeats it when the newest stamp is about to fall behind ROS time. A rospy.Timer would
    end when time is set back, and stand still with the clock.
    """

    def __init__(self, publisher: TransformPublisher) -> None:
        self._lock = threading.Lock()  # guards all below; nothing else is locked while it is held
        self._publisher = publisher
        self._map_from_odom: Optional[Pose2D] = None
        self._parent, self._child = "map", "odom"
        self._tolerance, self._enabled = 0.1, True
        self._sent = self._kept_until = rospy.Time(0)
        self._stamps: Deque[rospy.Time] = deque(maxlen=REMEMBERED)
        self._updated = self._taken_at = rospy.Time(0)
        self._stop = threading.Event()
        rospy.on_shutdown(self.close)
        threading.Thread(target=self._keep_alive, name="map_to_odom", daemon=True).start()

    def close(self) -> None:
        """End the thread."""
        self._stop.set()

    def configure(self, parent: str, child: str, tolerance: float, enabled: bool) -> None:
        """Set the frames of map and odometry, the tolerance (s) to add to stamps, and whether to send at all.

        After a change of the odometry frame, nothing is sent before the next scan.
        """
        with self._lock:
            if child != self._child:
                self._map_from_odom = None
            self._parent, self._child, self._tolerance, self._enabled = parent, child, tolerance, enabled

    def update(self, map_from_odom: Pose2D, stamp: rospy.Time) -> None:
        """Send the transform for a scan's stamp, and for now too if the last one was repeated with a newer stamp."""
        with self._lock:
            ahead, now = rospy.Duration(self._tolerance), rospy.get_rostime()
            self._map_from_odom, self._updated, self._taken_at = map_from_odom, stamp, now
            self._send(stamp + ahead)
            kept_until, self._kept_until = self._kept_until, rospy.Time(0)
            if kept_until > self._sent:
                self._send(now + ahead)

    def age(self) -> float:
        """Return the time (s) since the scan the transform is from, 0 before the first."""
        with self._lock:
            return (rospy.get_rostime() - self._updated).to_sec() if self._map_from_odom is not None else 0.0

    def _send(self, stamp: rospy.Time) -> None:
        while stamp in self._stamps:
            stamp += rospy.Duration(0, 1000)  # tf refuses a stamp that it has already
        if self._enabled and self._map_from_odom is not None:
            self._publisher.send(self._parent, self._child, self._map_from_odom, stamp)
            self._sent = stamp
            self._stamps.append(stamp)

    def _keep_alive(self) -> None:
        share = 1.0 if rospy.rostime.is_wallclock() else SIMULATED_SHARE
        wait = SHORTEST_LOOK
        while not self._stop.wait(wait):
            wait = min(max(share * self.repeat_if_due(rospy.get_rostime()), SHORTEST_LOOK), LONGEST_LOOK)

    def repeat_if_due(self, now: rospy.Time) -> float:
        """Repeat the transform if there was no scan for PAUSE and its stamp is about to fall behind `now`.

        Returns:
            The time (s) until the next check is due.
        """
        with self._lock:
            ahead, pause = rospy.Duration(self._tolerance), rospy.Duration(PAUSE)
            if self._map_from_odom is None or not self._enabled or now.is_zero():
                return PAUSE
            if now < self._taken_at:
                self._taken_at, self._sent = now, rospy.Time(0)  # time was set back
            due = float(max(self._taken_at + pause - now, self._sent - now - ahead * 0.5).to_sec())
            if due >= 0.0:
                return due
            self._send(now + ahead)
            self._kept_until = self._sent
            return 0.5 * self._tolerance
