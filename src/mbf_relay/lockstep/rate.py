"""Periodic events on a clock that advances by fixed steps."""

from __future__ import annotations

import math


class Rate:
    """Due at the first step at or after each multiple of its period; it counts steps, so that no rounding adds up."""

    def __init__(self, frequency: float, time_step: float) -> None:
        """Make a rate.

        Args:
            frequency: Hz, above 0.
            time_step: Seconds of one step of the clock.

        Raises:
            ValueError: The clock is too coarse for the frequency.
        """
        if frequency <= 0.0:
            raise ValueError(f"a rate is {frequency:g} Hz; it must be above 0")
        self._steps = 1.0 / (frequency * time_step)
        if self._steps < 1.0 - 1e-9:
            raise ValueError(
                f"a rate is {frequency:g} Hz; the simulation's step of {time_step:g} s allows {1.0 / time_step:g} Hz"
            )
        self._due = 0  # number of the step at which it is due next

    def steps_left(self, step: int) -> int:
        """Return how many steps after step number `step` it is due next, 1 or more."""
        return max(1, self._due - step)

    def take_turn(self, step: int) -> bool:
        """Advance to the next time if it is due at step number `step`; return whether it is.

        To be called with rising numbers, and with at least each step at which it is due.
        """
        if step < self._due:
            return False
        self._due = math.ceil((int((step + 1e-6) / self._steps) + 1) * self._steps - 1e-6)
        return True
