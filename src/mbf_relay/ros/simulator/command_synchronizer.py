"""Velocity commands on their way to the simulation, and the wait for the one that answers a scan."""

from __future__ import annotations

import threading
import time
from typing import Callable, Optional

from mbf_relay.geometry import STOP, Twist2D


class CommandSynchronizer:
    """Keeps the newest command for the simulation's thread, which can wait here for the next.

    A graph that is slower than the simulation would drive on old scans. With patience, no new scan is made before a
    command has come since the last one. It waits only while somebody drives: after an interval that brought a command,
    the last one not a stop. One lock guards all fields; nothing else is called with it held.
    """

    def __init__(self, patience: float) -> None:
        """Begin without a command; `patience` is the longest wait in wall seconds, 0 for none."""
        self._patience = patience
        self._changed = threading.Condition()
        self._newest: Optional[Twist2D] = None
        self._last = STOP
        self._since_scan = 0
        self._driven = False
        self.heard = 0
        self.given_up = 0

    def put(self, command: Twist2D) -> None:
        """Take a command, from any thread."""
        with self._changed:
            self._newest = self._last = command
            self._since_scan += 1
            self.heard += 1
            self._changed.notify_all()

    def take(self) -> Optional[Twist2D]:
        """Return the newest command, once; None where there is no new one."""
        with self._changed:
            command, self._newest = self._newest, None
            return command

    def wait_for_answer(self, cancelled: Callable[[], bool]) -> bool:
        """Wait, before a scan is made, for the answer to the last one.

        Args:
            cancelled: Asked every now and then; ends the wait.

        Returns:
            False where the patience ran out.
        """
        if self._patience <= 0.0:
            return True
        end = time.monotonic() + self._patience
        with self._changed:
            while self._driven and self._last != STOP and not self._since_scan and not cancelled():
                left = end - time.monotonic()
                if left <= 0.0:
                    self.given_up += 1
                    self._driven = False
                    return False
                self._changed.wait(min(left, 0.1))
        return True

    def scan_made(self) -> None:
        """Note that a scan went out; answers count from here."""
        with self._changed:
            self._driven = self._since_scan > 0
            self._since_scan = 0
