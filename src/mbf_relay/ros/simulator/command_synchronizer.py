"""Velocity commands on their way to the simulation, and the wait for the one that answers a scan."""

from __future__ import annotations

import threading
import time
from typing import Callable, Optional

from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.ros.common.clock_watch import CLOCK_STANDS

IN_VAIN = 2
"""Number of waits in vain after which one more scan per command is expected; a single one may be a slow machine."""
FORGET = 20
"""Number of scans, all answered or all unanswered, after which one command per scan is expected again."""


class CommandSynchronizer:
    """Keeps the newest command for the simulation's thread, which can wait here for the next.

    Nodes slower than the simulation would drive by old scans. With a patience above 0, no new scan is made before a
    command has come since the last one. It waits only while the robot is driven: after a command other than zero.

    A controller with a lower rate than the lidar's sends nothing before the clock, which stands during the wait, goes
    on. Such a wait is in vain: the patience ends, or the server stops a robot whose clock stands. After IN_VAIN of
    them, the wait comes one scan later.

    One lock guards all fields; while it is held only `cancelled` is called.

    Args:
        patience: The longest wait (wall s); 0 not to wait.
        clock: Returns wall time (s).

    Attributes:
        heard: Number of commands.
        given_up: Number of waits that ended with the patience.
    """

    def __init__(self, patience: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._patience, self._clock = patience, clock
        self._changed = threading.Condition()
        self._newest: Optional[Twist2D] = None
        self._driven = False
        self._unanswered = 0  # scans since the last command
        self._scans_per_command = 1
        self._in_vain = 0
        self._alike = 0  # intervals between two scans, the last one and those before it: answered if > 0, else not
        self.heard = 0
        self.given_up = 0

    def put(self, command: Twist2D) -> None:
        """Take a command, from any thread."""
        with self._changed:
            self._newest = command
            self._driven = command != STOP
            self._unanswered = 0
            self.heard += 1
            self._changed.notify_all()

    def take(self) -> Optional[Twist2D]:
        """Return the newest command, once; None where there is no new one."""
        with self._changed:
            command, self._newest = self._newest, None
            return command

    def wait_for_answer(self, cancelled: Callable[[], bool]) -> bool:
        """Wait, before a scan is made, for the command it is due after.

        Args:
            cancelled: Asked every now and then; ends the wait.

        Returns:
            False where the patience ran out.
        """
        if self._patience <= 0.0:
            return True
        begin = self._clock()
        with self._changed:
            if self._unanswered != self._scans_per_command:
                return True
            while self._driven and self._unanswered and not cancelled():
                left = begin + self._patience - self._clock()
                if left <= 0.0:
                    self.given_up += 1
                    self._driven = False
                    self._wait_later()
                    return False
                self._changed.wait(min(left, 0.1))
            if not self._driven and self._clock() - begin >= CLOCK_STANDS:
                self._wait_later()
        return True

    def scan_made(self) -> None:
        """Note that a scan went out; answers count from here."""
        with self._changed:
            if self._unanswered:
                self._alike = min(self._alike, 0) - 1
            else:
                self._alike = max(self._alike, 0) + 1
            self._unanswered += 1
            if abs(self._alike) >= FORGET:
                self._scans_per_command, self._in_vain = 1, 0

    def _wait_later(self) -> None:
        """Take note of a wait in vain; with the lock held."""
        self._in_vain += 1
        if self._in_vain >= IN_VAIN:
            self._scans_per_command, self._in_vain = self._scans_per_command + 1, 0
