"""Watchdog that stops the robot, and reports the server as not alive, where a step of navigation hangs."""

from __future__ import annotations

import threading
from typing import Callable, List

import rospy

from mbf_relay.ros.common.stepper import STEP_PATIENCE, Stepper
from mbf_relay.ros.server.robot import RosRobot

PERIOD = 0.1
"""Wall seconds between two checks of the stepping thread."""
LOOKS = 9
"""Number of checks in a row that must see the same running step before goals are ended. After a suspension of the whole
process there was none, and goals go on."""


class Watchdog:
    """Stops the robot and ends running goals where one step takes longer than STEP_PATIENCE of the wall clock.

    It has a thread of its own, which waits for no lock that navigation or a costmap holds. Commands of the hanging step
    are dropped until the next step begins, which drops all goals (`settle`). If the watchdog did not run either, as on
    a computer that was busy or suspended, the robot is only stopped until the next step. While the simulated clock
    stands still, the robot is held at zero, and the drive goes on with the clock.

    Args:
        stepper: The stepping thread.
        robot: The robot to stop.
        end_goals: Aborts running goals with a text; called from the watchdog's thread.
        hung: Returns a text for each costmap that hangs.

    Attributes:
        trouble: Why the present step counts as hanging, empty where it does not.
    """

    def __init__(
        self, stepper: Stepper, robot: RosRobot, end_goals: Callable[[str], None], hung: Callable[[], List[str]]
    ) -> None:
        self._stepper, self._robot, self._end_goals, self._hung = stepper, robot, end_goals, hung
        self._stop = threading.Event()
        # held while the robot is blocked and while a step begins, or a robot that was just released could be blocked
        # again for good; taken before the locks of robot and actions
        self._lock = threading.Lock()
        self.trouble = ""

    def start(self) -> None:
        """Start the thread."""
        threading.Thread(target=self._loop, name="watchdog", daemon=True).start()

    def stop(self) -> None:
        """End the thread."""
        self._stop.set()

    def is_alive(self) -> bool:
        """Return whether no step hangs; the action servers publish their status only then."""
        return self._stepper.step_time <= STEP_PATIENCE

    def settle(self) -> str:
        """Release the robot at the beginning of a step; return why the last step hung, empty where it did not."""
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
        self._stepper.wake()  # so that the next step, which starts over, follows at once
