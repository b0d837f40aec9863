"""Commands that reach the wheels late, as over a slow network or on a busy machine: legs of the circle driven so."""

from __future__ import annotations

from typing import Iterator, List, Tuple

import numpy as np

from benchmark.metric import Metric, metric_of
from mbf_relay.lockstep.graph import Graph
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import Setup, make_setup
from mbf_relay.lockstep.stages import Stages
from mbf_relay.lockstep.tasks import circle
from mbf_relay.navigation.goals import FramedPose, NavigateGoal
from mbf_relay.navigation.task import Ending
from mbf_relay.simulation.faults import Faults

DELAYS = (0.0, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2)
"""Seconds by which commands are late all the way."""
CHANGING = (0.15, 0.3, 0.5)
"""Seconds by which they are late on the mean, where that is another time each second, from none to twice as much."""
PATIENCE = 120.0
"""Seconds after which a leg is given up."""


def metrics(quick: bool) -> Iterator[Metric]:
    """Yield for each delay how many legs end at their goals, how long they take, and steps with a contact."""
    setup = make_setup(config_folder())
    seeds = range(1, 2 if quick else 5)
    for changing, delays in ((False, DELAYS), (True, CHANGING)):
        for delay in delays:
            legs, contacts = [], 0
            for seed in seeds:
                driven, touched = _drive(setup, seed, delay, changing)
                legs += driven
                contacts += touched
            where = {"delay": f"{delay:g} s", "changing": changing, "seeds": len(seeds)}
            arrived = sum(has_arrived for has_arrived, _ in legs)
            yield Metric("legs that ended at their goal", 100.0 * arrived / len(legs), "%", parameters=where)
            yield metric_of("time of a leg", [seconds for _, seconds in legs], "s", **where)
            yield Metric("time of a leg, mean", float(np.mean([s for _, s in legs])), "s", parameters=where)
            yield Metric("steps with a contact", contacts, "", parameters=where)


def _drive(setup: Setup, seed: int, delay: float, changing: bool) -> Tuple[List[Tuple[bool, float]], int]:
    """Return for each leg of the circle whether it ended at its goal and after how long (s), and steps with a contact.
    """
    rng = np.random.default_rng([seed, 7])
    graph = Graph(circle(), setup, seed, Stages(None), lambda now, velocity: None)
    legs, contacts, changed_at = [], 0, -np.inf
    try:
        while graph.waits_for() is not None:
            graph.step()
        graph.simulation.faults = Faults(command_delay=delay)
        for goal in circle().goals:
            began = graph.now
            task = graph.navigate(NavigateGoal(FramedPose(goal, graph.map_frame)))
            while not task.done and graph.now - began < PATIENCE:
                if changing and graph.now - changed_at >= 1.0:
                    late, changed_at = float(rng.uniform(0.0, 2.0 * delay)), graph.now
                    graph.simulation.faults = Faults(command_delay=late)
                contacts += bool(graph.step().contacts)
                task.take_feedback()
            legs.append((task.done and task.ending is Ending.SUCCEEDED, graph.now - began))
    finally:
        graph.close()
    return legs, contacts
