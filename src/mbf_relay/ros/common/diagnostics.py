"""A node's status on /diagnostics, once a second."""

from __future__ import annotations

import math
import threading
import time
from typing import Callable, Dict, List, Mapping, Optional, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from mbf_relay.outcomes import as_told

OK = DiagnosticStatus.OK
WARN = DiagnosticStatus.WARN
ERROR = DiagnosticStatus.ERROR
STALE = DiagnosticStatus.STALE

Report = Tuple[int, str, Mapping[str, object]]
"""Level, message (one line) and values by name, as in diagnostic_msgs/DiagnosticStatus."""


class Diagnostics:
    """Publishes the reports of a node's parts, by the wall clock, so that it goes on while /clock stands still.

    Args:
        period: Wall seconds between two messages.
    """

    def __init__(self, period: float = 1.0) -> None:
        self._reporters: Dict[str, Callable[[], Report]] = {}
        self._cpu = CpuShare()
        self._publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=10)
        self._stop = threading.Event()
        self._period = period
        self._thread = threading.Thread(target=self._loop, name="diagnostics", daemon=True)
        rospy.on_shutdown(self._stop.set)
        self._thread.start()

    def add(self, name: str, reporter: Callable[[], Report]) -> None:
        """Call `reporter` once a period; it must be quick and safe to call from another thread."""
        self._reporters[name] = reporter

    def _loop(self) -> None:
        while not self._stop.wait(self._period):
            self._publish()

    def _publish(self) -> None:
        share = self._cpu.percent()
        statuses: List[DiagnosticStatus] = []
        for name, reporter in list(self._reporters.items()):
            try:
                level, message, values = reporter()
            except Exception as error:  # reported as an error of this part; the others are still published
                level, message, values = ERROR, f"cannot be told: {type(error).__name__}: {error}", {}
            told = {**values, "cpu [%]": f"{share:.1f}"}
            pairs = [KeyValue(as_told(key), as_told(value)) for key, value in told.items()]
            statuses.append(
                DiagnosticStatus(level, f"{rospy.get_name().lstrip('/')}: {name}", as_told(message), "mbf_relay", pairs)
            )
        if statuses and not rospy.is_shutdown():
            array = DiagnosticArray(status=statuses)
            array.header.stamp = rospy.get_rostime()
            try:
                self._publisher.publish(array)
            except rospy.ROSException:
                self._stop.set()


class CpuShare:
    """CPU usage of this process, in percent of one core, since the last call."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.monotonic(), time.process_time()

    def percent(self) -> float:
        """Return the share in percent of one core."""
        wall, cpu = time.monotonic(), time.process_time()
        share = 100.0 * (cpu - self._cpu) / max(1e-6, wall - self._wall)
        self._wall, self._cpu = wall, cpu
        return share


class RateMeter:
    """Measures the rate of events over the last twenty, by whatever clock the caller passes in.

    Args:
        pause: Time (s) without an event after which counting starts over, for events that come in bursts.
    """

    LATE = 0.8
    """Fraction of the wanted rate below which `lags` is true."""
    ENOUGH = 10
    """Events that `lags` needs before it can be true."""

    def __init__(self, pause: float = math.inf) -> None:
        self._pause = pause
        self._lock = threading.Lock()
        self._stamps: List[float] = []

    def tick(self, now: float) -> None:
        """Note one event at `now` (s)."""
        with self._lock:
            if self._stamps and not 0.0 <= now - self._stamps[-1] <= self._pause:
                self._stamps.clear()
            self._stamps = self._stamps[-19:] + [now]

    def rate(self) -> float:
        """Return events per second, 0 before the second one."""
        with self._lock:
            return self._rate()

    def age(self, now: float) -> Optional[float]:
        """Return the time (s) since the last event, None before the first."""
        with self._lock:
            return now - self._stamps[-1] if self._stamps else None

    def lags(self, asked: float) -> bool:
        """Return whether the rate of the last events is below LATE of `asked` (1/s); False before enough events."""
        with self._lock:
            return len(self._stamps) > self.ENOUGH and self._rate() < self.LATE * asked

    def _rate(self) -> float:
        span = self._stamps[-1] - self._stamps[0] if len(self._stamps) > 1 else 0.0
        return (len(self._stamps) - 1) / span if span > 0.0 else 0.0
