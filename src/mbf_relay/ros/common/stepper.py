"""The thread that steps navigation: it sleeps until a step is due by ROS time, or until it is woken."""

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
"""Longest wall seconds between two steps while one is due, also while ROS time stands still or was set back."""
STEP_PATIENCE = 1.0
"""Wall seconds after which a step counts as hanging."""
CLOCK_PATIENCE = 2.0
"""Wall seconds without a publisher of /clock after which it counts as lost; a simulator may restart meanwhile."""
FIRST_CLOCK = 20.0
"""Wall seconds a simulator may take to publish its first /clock: as long as goals wait for a server."""
PYTHONS_OWN = os.path.dirname(threading.__file__)
"""Folder of Python's standard library, whose stack frames `hangs_in` skips: locks, queues, sockets."""


class Stepper:
    """Calls `step(now)` repeatedly: at the time that it returned last, or when woken.

    In simulated time the callback of /clock compares each message with that time; nothing polls.

    Args:
        step: Takes ROS time (s) and returns when it is to be called next (s), infinite for only when woken; must not
            raise.
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
        """Start the thread."""
        if self._simulated:
            self._clock = rospy.Subscriber("/clock", Clock, self._on_clock, queue_size=1, tcp_nodelay=True)
        self._thread.start()

    def wake(self) -> None:
        """Have a step done now; from any thread."""
        self._wake.set()

    @property
    def step_time(self) -> float:
        """Wall seconds that the running step has taken so far; 0 between two steps."""
        began = self._began
        return 0.0 if began is None else time.monotonic() - began

    @property
    def hangs_in(self) -> str:
        """Where a step that takes too long is executing, such as "my_layer.py, line 7"; empty while none does."""
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
        """Whether time is simulated and stands still."""
        return self._simulated and self._watch.stands

    @property
    def clock_loss(self) -> str:
        """Why simulated time is lost: nobody publishes /clock, or nobody does any more. Else empty.

        A clock that stands still while it has a publisher is not lost: the simulation may be paused.
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
        """End the thread, waiting up to 2 s for the running step."""
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
            if self._stopping:  # checked after `clear`: a stop in between would be cleared unseen
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
