"""One drive through a world: the nodes' core objects in one process, on the simulation's clock."""

from __future__ import annotations

import random
from typing import Any, Callable, Dict, List, Optional, Tuple

import numpy as np
import psutil

from mbf_relay.geometry import STOP
from mbf_relay.lockstep import result as outcomes
from mbf_relay.lockstep.graph import Graph
from mbf_relay.lockstep.rate import Rate
from mbf_relay.lockstep.record import SAMPLING, Record
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.setup import Setup
from mbf_relay.lockstep.stages import Stages
from mbf_relay.lockstep.tasks import EpisodeTask
from mbf_relay.navigation.goals import FramedPose, NavigateGoal, NavigateResult
from mbf_relay.navigation.task import Ending, Task
from mbf_relay.outcomes import ControlOutcome

WARM_UP = 5.0
"""Simulated seconds within which scans, pose and costmaps must be available."""

AT_MOST = 4.0
"""Bound on the robot's speed, also when it is pushed, as a multiple of its top speed. From the distance to the goal it
gives the earliest time at which the goal can be reached; before that the check is skipped."""


class Episode:
    """One drive of a task with a seed. Equal arguments give equal drives, bit by bit."""

    def __init__(self, task: EpisodeTask, setup: Setup, seed: int, clock: Optional[Callable[[], float]] = None) -> None:
        """Build the simulation and the navigation stack.

        Args:
            task: The world and the goals.
            setup: The parameters.
            seed: Seed of all random numbers.
            clock: Gives wall time (s) for the times per stage, which are left out where None; nothing else depends
                on it.

        Raises:
            ValueError: The robot cannot stand at the start, or a parameter is wrong.
        """
        self.task, self.setup, self.seed = task, setup, seed
        _seed_chance_of_plugins(seed)
        self._stages = Stages(clock)
        self._clock = clock
        self._began = clock() if clock is not None else 0.0
        self._graph = Graph(task, setup, seed, self._stages, self._note_command)
        self._record: Optional[Record] = None
        self._sampling = Rate(SAMPLING, self._graph.time_step)
        self._goal: Optional[Task[NavigateResult]] = None
        self._reached: List[float] = []
        self._deadline = self._near_goal_from = 0.0

    def run(self) -> EpisodeResult:
        """Drive until all goals are reached, navigation fails, the robot touches something, or the time limit.

        With the setup's `after_contact` the drive goes on after a contact. Call once.
        """
        try:
            if not self._warm_up():
                return self.task.failed(self.seed, f"not ready after {WARM_UP:g} s: {self._graph.waits_for()}")
            outcome, message = self._drive()
            self._note_now()
            assert self._record is not None
            top_speed = self._graph.simulation.parameters.max_speed
            tolerance = self._graph.goal_tolerance if self.task.goal_radius is None else None
            return self._record.result(outcome, message, top_speed, self._reached, tolerance, self._machine())
        finally:
            self._graph.close()

    def _warm_up(self) -> bool:
        """Step until pose and costmaps are available; return whether they are, within WARM_UP."""
        while self._graph.waits_for() is not None:
            if self._graph.elapsed > WARM_UP:
                return False
            self._graph.step()
        return True

    def _drive(self) -> Tuple[str, str]:
        """Drive to the end; return outcome and message."""
        graph, task = self._graph, self.task
        self._record = Record(
            task, self.seed, graph.simulation.parameters.start_time, graph.simulation.robot
        )
        self._deadline = graph.now + task.time_limit
        graph.navigator.recovery_watcher = self._note_recovery
        self._note_now()
        self._send_goal()
        while True:
            contacts, navigated = graph.step(self._sampling.steps_left(graph.steps))
            if contacts:
                self._record.note_contacts(
                    graph.now, contacts, graph.simulation.true_pose, graph.robot.commanded or STOP)
                if not self.setup.after_contact:
                    return outcomes.CONTACT, self._record.touches.first
            if self._sampling.take_turn(graph.steps):
                self._note_now()
            ended = self._ended() if navigated else None
            if ended is not None:
                return self._judged(*ended)

    def _judged(self, outcome: str, message: str) -> Tuple[str, str]:
        """Return outcome and message of a drive that ended so; CONTACT where the robot touched something before."""
        assert self._record is not None
        first = self._record.touches.first
        if not first:
            return outcome, message
        return outcomes.CONTACT, f"{first}; went on: {': '.join(filter(None, (outcome, message)))}"

    def _ended(self) -> Optional[Tuple[str, str]]:
        """Return outcome and message where the drive is over; send the next goal where one was reached."""
        graph, assigned = self._graph, self._goal
        assert assigned is not None
        if self._is_within_radius() or assigned.ending is Ending.SUCCEEDED:
            self._reached.append(graph.now)
            if len(self._reached) == len(self.task.goals):
                return outcomes.SUCCEEDED, ""
            self._send_goal()
        elif assigned.done:
            result = assigned.ended_with()
            return result.outcome.name, result.message
        if graph.now > self._deadline:
            late = f"goal {len(self._reached) + 1} of {len(self.task.goals)} not reached in time"
            refusals = [told for told in assigned.take_feedback() if told.outcome is not ControlOutcome.SUCCESS]
            for refusal in refusals[-1:]:
                late += f"; the controller last said {refusal.outcome.name}: {refusal.message}"
            return outcomes.TIMEOUT, late
        return None

    def _is_within_radius(self) -> bool:
        radius, graph = self.task.goal_radius, self._graph
        if radius is None or graph.now < self._near_goal_from:
            return False
        way = graph.simulation.true_pose.distance_to(self.task.goals[len(self._reached)]) - radius
        self._near_goal_from = graph.now + max(0.0, way) / (AT_MOST * graph.simulation.parameters.max_speed)
        return way <= 0.0

    def _send_goal(self) -> None:
        goal = FramedPose(self.task.goals[len(self._reached)], self._graph.map_frame)
        self._near_goal_from = 0.0
        tolerance = self.task.goal_radius or 0.0
        self._goal = self._graph.navigate(
            NavigateGoal(goal, self.setup.planner, self.setup.controller, tolerance=tolerance))

    def _note_now(self) -> None:
        assert self._record is not None
        self._record.note(self._graph.now, self._graph.simulation.true_pose, self._graph.robot.base_in_map)

    def _note_command(self, now: float, velocity: Any) -> None:
        if self._record is not None:
            self._record.note_command(now, velocity)

    def _note_recovery(self, *_: Any) -> None:
        assert self._record is not None
        self._record.recoveries += 1

    def _machine(self) -> Dict[str, Any]:
        memory = psutil.Process().memory_info().rss / 2**20  # current; a forked process inherits its parent's peak
        if self._clock is None:
            return {"memory_mib": round(memory, 1)}
        seconds = {name: round(value, 4) for name, value in sorted(self._stages.seconds.items())}
        return {"wall": round(self._clock() - self._began, 4), "stages": seconds, "memory_mib": round(memory, 1)}


def _seed_chance_of_plugins(seed: int) -> None:
    """Seed Python's and NumPy's global generators; this package does not use them, but a user's plugins may."""
    random.seed(seed)
    np.random.seed(seed % 2**32)
