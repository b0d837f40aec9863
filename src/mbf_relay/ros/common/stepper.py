"""The one thread that steps navigation: asleep until something is due on the ROS clock or somebody asks for something.
"""

from __future__ import annotations

import math
import threading
import time
from typing import Callable, Optional

import rospy
from rosgraph_msgs.msg import Clock

STILL_CLOCK = 1.0
"""Wall seconds between two steps while time stands still or is set back, so that nothing depends on its going on."""
STEP_PATIENCE = 1.0
"""Wall seconds a step may take before whoever watches it must take it for hung."""
CLOCK_STANDS = 0.5
"""Wall seconds without simulated time after which the wheels must not go on by what was sent before."""
TICKS_LATE = 3.0
"""Times as long as the last tick took to come, as far as that is more: simulations far below real time tick slowly."""
CLOCK_PATIENCE = 2.0
"""Wall seconds a simulator may take to come back before the clock it published counts as lost."""


class Stepper:
    """Calls `step(now)`, which returns the time (s) of its next need, and calls it again then or when woken.

    On the simulated clock each message of /clock is compared with that time, in the callback; nothing polls.

    Args:
        step: Must not raise.
    """

    def __init__(self, step: Callable[[float], float]) -> None:
        self._step = step
        self._wake = threading.Event()
        self._stopping = False
        self._due, self._last = math.inf, -math.inf
        self._began: Optional[float] = None
        self._simulated = rospy.rostime.is_wallclock() is False
        self._thread = threading.Thread(target=self._loop, name="stepper", daemon=True)
        self._clock: Optional[rospy.Subscriber] = None
        self._ticked_at: Optional[float] = None
        self._time_shown, self._ran_at, self._tick_period = -math.inf, math.inf, 0.0

    def start(self) -> None:
        """Begin stepping."""
        if self._simulated:
            self._clock = rospy.Subscriber("/clock", Clock, self._on_clock, queue_size=1, tcp_nodelay=True)
        self._thread.start()

    def wake(self) -> None:
        """Step now; from any thread."""
        self._wake.set()

    @property
    def step_time(self) -> float:
        """Wall seconds the running step has taken so far; 0 between two steps, for sleeping is no hanging."""
        began = self._began
        return 0.0 if began is None else time.monotonic() - began

    @property
    def clock_stands(self) -> bool:
        """Whether the simulated clock ran and now shows one time for much longer than it took from tick to tick.

        It may be paused, or whoever publishes it may hang; a wheel on the wall clock knows nothing of either.
        """
        return time.monotonic() - self._ran_at > max(CLOCK_STANDS, TICKS_LATE * self._tick_period)

    @property
    def clock_loss(self) -> str:
        """How the simulated clock was lost, or empty.

        A clock that stands is none: a simulation may be paused. One that ran and that nobody publishes any more is.
        """
        if self._ticked_at is None or self._clock is None or self._clock.get_num_connections() > 0:
            return ""
        silence = time.monotonic() - self._ticked_at
        if silence < CLOCK_PATIENCE:
            return ""
        return f"/clock has stood at {rospy.get_time():.2f} s for {silence:.1f} s and nobody publishes it any more"

    def stop(self) -> None:
        """End stepping and wait for the running step."""
        self._stopping = True
        self._wake.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(2.0)

    def _on_clock(self, message: Clock) -> None:
        self._ticked_at = time.monotonic()
        now = message.clock.to_sec()
        if now != self._time_shown:
            self._tick_period = max(0.0, self._ticked_at - self._ran_at)
            self._time_shown, self._ran_at = now, self._ticked_at
        if now >= self._due or (now < self._last and math.isfinite(self._due)):
            self._wake.set()

    def _loop(self) -> None:
        while not self._stopping:
            self._wake.clear()
            now = rospy.get_time()
            self._last = now
            self._began = time.monotonic()
            self._due = self._step(now)
            self._began = None
            self._sleep(self._due - rospy.get_time())

    def _sleep(self, remaining: float) -> None:
        if remaining == math.inf:
            self._wake.wait()
        elif remaining > 0.0:
            self._wake.wait(STILL_CLOCK if self._simulated else min(remaining, STILL_CLOCK))
