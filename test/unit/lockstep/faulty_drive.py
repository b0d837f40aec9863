"""A drive without ROS that a test makes go wrong on its way."""

import math

from mbf_relay.geometry import Pose2D
from mbf_relay.lockstep.graph import Graph
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import make_setup
from mbf_relay.lockstep.stages import Stages
from mbf_relay.lockstep.tasks import circle
from mbf_relay.navigation.goals import FramedPose, NavigateGoal, RecoverGoal
from mbf_relay.navigation.task import Ending
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Box

SETUP = make_setup(config_folder())


class FaultyDrive(Graph):
    """A drive to a goal of the circle, by its index, whose scans a test can change on their way."""

    def __init__(self, seed, goal=1):
        self.place = circle().goals[goal]
        self.change_scan = lambda scan: scan
        self.commands = []
        super().__init__(
            circle(), SETUP, seed, Stages(None), lambda now, velocity: self.commands.append((now, velocity))
        )
        self.said = set()
        self.step_until(lambda: self.waits_for() is None, 5.0)
        self.goal = self.navigate(NavigateGoal(FramedPose(self.place, self.map_frame)))

    def _take_scan(self, scan):
        changed = self.change_scan(scan)
        if changed is not None:
            super()._take_scan(changed)

    def step_until(self, condition, seconds):
        """Step until the condition holds; returns whether it came to hold within so many seconds."""
        end = self.now + seconds
        while not condition() and self.now < end:
            contacts = self.step().contacts
            assert not contacts, f"the robot touched {contacts[0].name} at {self.now:.2f} s"
            if hasattr(self, "goal"):
                self.said.update(feedback.message for feedback in self.goal.take_feedback())
        return bool(condition())

    def set_down_ahead(self, distance):
        """Set a box down on the robot's way, so far (m) ahead of its middle."""
        there = self.simulation.true_pose.compose(Pose2D(distance, 0.0, 0.0))
        self.set_down("box", Box((0.2, 0.2, 0.4)), there, 0.2)

    def set_down(self, name, shape, there, height):
        """Set something down.

        Args:
            name: By which it can be taken away.
            shape: Its shape.
            there: Pose of its middle.
            height: Of its middle above the ground (m).
        """
        self.simulation.scene.set_obstacle(name, Body(name, shape, Frame.of(there.x, there.y, height)))

    def arrive(self):
        """Go on to the goal, sent again where it has ended meanwhile."""
        if self.goal.done and self.goal.ending is not Ending.SUCCEEDED:
            self.goal = self.navigate(NavigateGoal(FramedPose(self.place, self.map_frame)))
        assert self.step_until(lambda: self.goal.done, 90.0), "it never arrived"
        assert self.goal.ending is Ending.SUCCEEDED, self.goal.result
        assert self.simulation.true_pose.distance_to(self.place) < 0.35

    def recover(self, behavior):
        """Run a recovery behaviour by its name; returns its task."""
        self._next_update = -math.inf
        return self.navigator.recovery(RecoverGoal(behavior))

    def is_driving(self):
        return bool(self.commands) and self.commands[-1][1].x > 0.15
