"""Stops the robot, and reports the server as not alive, where navigation hangs."""

from __future__ import annotations

import threading
from typing import Callable, List

import rospy

from mbf_relay.ros.common.stepper import STEP_PATIENCE, Stepper
from mbf_relay.ros.server.robot import RosRobot

PERIOD = 0.1
"""Wall seconds between two looks at the stepper."""
LOOKS = 9
"""Looks in a row at a step that goes on, after which it hangs; a process that was not run itself has not looked."""


class Watchdog:
    """Stops the robot and ends the goals in pursuit where one step takes longer than a second of the wall clock.

    A thread of its own, which waits for no lock that navigation or a costmap holds. What the step still commands is
    dropped until the next step begins, and that one starts from nothing (`settle`). A step that took so long because
    nothing ran, the watchdog neither, as where the computer was busy or asleep, only stops the robot until the next
    one. While the simulated clock stands, no step comes that could send another velocity: the wheels stand, and the
    drive goes on with the clock.

    Args:
        stepper: The stepping thread.
        robot: What is stopped.
        end_goals: Ends, with a text, the goals in pursuit; called from the watchdog's thread.
        hung: Tells what else hangs that navigation may wait for, and where, one text for each.
    """

    def __init__(
        self, stepper: Stepper, robot: RosRobot, end_goals: Callable[[str], None], hung: Callable[[], List[str]]
    ) -> None:
        self._stepper, self._robot, self._end_goals, self._hung = stepper, robot, end_goals, hung
        self._stop = threading.Event()
        # held while it stops the robot and while a step begins, or a robot let go would be stopped once more, for good;
        # taken before the locks of robot and actions
        self._lock = threading.Lock()
        self.trouble = ""

    def start(self) -> None:
        """Watch from now on."""
        threading.Thread(target=self._loop, name="watchdog", daemon=True).start()

    def stop(self) -> None:
        """Watch no longer."""
        self._stop.set()

    def is_alive(self) -> bool:
        """Return whether navigation is being stepped; asked before the server reports itself alive."""
        return self._stepper.step_time <= STEP_PATIENCE

    def settle(self) -> str:
        """Let the robot drive again, at the beginning of a step; returns what was wrong with the last one, or empty."""
        with self._lock:
            trouble, self.trouble = self.trouble, ""
            self._robot.release()
            return trouble

    def _loop(self) -> None:
        looks = 0
        while not self._stop.wait(PERIOD):
            looks = looks + 1 if self._stepper.step_time > PERIOD else 0
            with self._lock:
                if not self.is_alive():
                    self._robot.block()
                    if looks >= LOOKS:
                        self._bark()
            self._robot.hold(self._stepper.clock_stands)

    def _bark(self) -> None:
        if not self.trouble:
            where = "; ".join([f"navigation hangs in {self._stepper.hangs_in or 'what has just ended'}", *self._hung()])
            self.trouble = f"{where}: a step has taken more than {STEP_PATIENCE:g} s; the robot was stopped"
            rospy.logerr("%s", self.trouble)
        self._end_goals(self.trouble)
        self._stepper.wake()  # a next step, in which everything begins anew, shall follow at once
