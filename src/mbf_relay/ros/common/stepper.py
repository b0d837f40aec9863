"""The one thread that steps navigation: asleep until something is due on the ROS clock or somebody asks for something.
"""

from __future__ import annotations

import math
import os
import sys
import threading
import time
from typing import Callable, Optional

import rospy
from rosgraph_msgs.msg import Clock

from mbf_relay.ros.common.clock_watch import ClockWatch
from mbf_relay.timing import ROUNDING

STILL_CLOCK = 1.0
"""Wall seconds between two steps while time stands still or is set back, so that nothing depends on its going on."""
STEP_PATIENCE = 1.0
"""Wall seconds a step may take before whoever watches it must take it for hung."""
CLOCK_PATIENCE = 2.0
"""Wall seconds a simulator may take to come back before the clock it published counts as lost."""
FIRST_CLOCK = 20.0
"""Wall seconds it may take to come up: as long as goals wait for a server."""
PYTHONS_OWN = os.path.dirname(threading.__file__)
"""Folder of what a step waits in and nobody looks for: locks, queues, sockets."""


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
        self._watch, self._has_ticked, self._ticked_at = ClockWatch(), False, time.monotonic()

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
    def hangs_in(self) -> str:
        """Where the running step is that takes too long, such as "my_layer.py, line 7"; empty while none does."""
        if self.step_time <= STEP_PATIENCE:
            return ""
        frame = sys._current_frames().get(self._thread.ident or 0)
        while frame is not None and os.path.dirname(frame.f_code.co_filename) == PYTHONS_OWN:
            frame = frame.f_back
        if frame is None:  # it has just ended
            return ""
        return f"{os.path.basename(frame.f_code.co_filename)}, line {frame.f_lineno}"

    @property
    def clock_stands(self) -> bool:
        """Whether time is simulated and does not go on."""
        return self._simulated and self._watch.stands

    @property
    def clock_loss(self) -> str:
        """How the simulated clock was lost, or empty.

        A clock that stands is none: a simulation may be paused. One that nobody publishes, or no longer, is.
        """
        if self._clock is None or self._clock.get_num_connections() > 0:
            return ""
        silence = time.monotonic() - self._ticked_at
        if silence < (CLOCK_PATIENCE if self._has_ticked else FIRST_CLOCK):
            return ""
        if not self._has_ticked:
            return f"nobody has published /clock for {silence:.0f} s, by which all time goes where use_sim_time is set"
        return f"/clock has stood at {rospy.get_time():.2f} s for {silence:.1f} s and nobody publishes it any more"

    def stop(self) -> None:
        """End stepping and wait for the running step."""
        self._stopping = True
        self._wake.set()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join(2.0)

    def _on_clock(self, message: Clock) -> None:
        self._has_ticked, self._ticked_at = True, time.monotonic()
        now = message.clock.to_sec()
        self._watch.note(now)
        if now >= self._due - ROUNDING or (now < self._last and math.isfinite(self._due)):
            self._wake.set()

    def _loop(self) -> None:
        while True:
            self._wake.clear()
            if self._stopping:  # after that, or a stop in between would wake nobody
                return
            now = rospy.get_time()
            self._last = now
            self._began = time.monotonic()
            self._due = self._step(now)
            self._began = None
            self._sleep(self._due - rospy.get_time())

    def _sleep(self, remaining: float) -> None:
        if remaining == math.inf:
            self._wake.wait()
        elif remaining > ROUNDING:
            self._wake.wait(STILL_CLOCK if self._simulated else min(remaining, STILL_CLOCK))
