"""A navigator with scripted plugins on a fake clock."""

from typing import Any, Callable

import scripted

from mbf_relay.geometry import STOP
from mbf_relay.navigation.navigator import Navigator


class Bench:
    """A navigator with scripted plugins, and the clock that drives it."""

    def __init__(self, worker: Any = None, **parameters: Any) -> None:
        self.script = scripted.new_script()
        self.robot = scripted.PaperRobot()
        self.costmaps = {"global": scripted.PaperCostmap("map"), "local": scripted.PaperCostmap("odom")}
        self.worker = worker
        self.navigator = Navigator(scripted.config(**parameters), self.robot, self.costmaps, worker)
        self.now = 1000.0

    def step(self, seconds: float = 0.1) -> None:
        """Let time pass and step."""
        self.now += seconds
        self.robot.move(seconds)
        if isinstance(self.worker, scripted.HeldWorker):
            self.worker.step()
        self.navigator.update(self.now)

    def run(self, until: Callable[[], Any], seconds: float = 30.0, period: float = 0.1) -> Any:
        """Step until a condition holds, within so many seconds of the fake clock."""
        end = self.now + seconds
        self.navigator.update(self.now)
        while not until():
            assert self.now < end, f"waited {seconds} s of the fake clock, in vain"
            self.step(period)
        return until()

    def finish(self, task: Any, seconds: float = 60.0) -> Any:
        """Step until a task is done; the robot must then have been told to stand, if it was told anything."""
        self.run(lambda: task.done, seconds)
        if self.navigator.idle and self.robot.sent:
            assert self.robot.sent[-1] == STOP
        return task.result
