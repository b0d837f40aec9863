"""Small worlds that a robot crosses in seconds, and plugins that misbehave."""

import json
import random
from dataclasses import dataclass

import numpy as np

from mbf_relay.control.controller import Controller
from mbf_relay.costmap.layer import Layer
from mbf_relay.geometry import STOP, Twist2D
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.planning.planner import Planner

FREE = {"name": "free", "cylinders": [[1.0, 0.6, 0.1, 0.5], [1.0, -0.6, 0.1, 0.5]], "start": [0.0, 0.0, 0.0],
        "goal": [1.6, 0.1, 0.0], "goal_radius": 0.3, "reference_path_length": 1.6, "time_limit": 30.0}
NEAR = {**FREE, "goal": [0.4, 0.0, 0.0], "reference_path_length": 0.4}
"""For what any drive shows that succeeds."""
BENT = {**FREE, "name": "bent", "cylinders": [[0.8, 0.05, 0.15, 0.5]]}
BLOCKED_START = {**FREE, "name": "blocked_start", "cylinders": [[0.05, 0.05, 0.1, 0.5]]}
WALLED_IN = {
    **FREE,
    "name": "walled_in",
    "time_limit": 4.0,
    "cylinders": [
        [0.6 * x, 0.6 * y, 0.12, 0.5]
        for x, y in [
            (1, 0),
            (0.92, 0.38),
            (0.71, 0.71),
            (0.38, 0.92),
            (0, 1),
            (-0.38, 0.92),
            (-0.71, 0.71),
            (-0.92, 0.38),
            (-1, 0),
            (0.92, -0.38),
            (0.71, -0.71),
            (0.38, -0.92),
            (0, -1),
            (-0.38, -0.92),
            (-0.71, -0.71),
            (-0.92, -0.38),
        ]
    ],
}
RUN_OVER = {
    **FREE, "name": "run_over", "cylinders": [],
    "movers": [{"radius": 0.15, "height": 0.5, "waypoints": [[0.0, 2.5, 0.0], [4.0, -1.0, 0.0]], "loop": False}],
}


def moved(world, x, y):
    """Return a world of cylinders that lies elsewhere (m)."""
    def there(place):
        return [place[0] + x, place[1] + y, *place[2:]]

    return {**world, "start": there(world["start"]), "goal": there(world["goal"]),
            "cylinders": [there(cylinder) for cylinder in world["cylinders"]]}


def write(path, *worlds):
    """Write a worlds file and return its path as text."""
    path.write_text(json.dumps({"worlds": list(worlds)}))
    return str(path)


class Throwing(Controller):
    """A controller with a mistake in it."""

    def set_path(self, path, is_new_goal):
        pass

    def compute_velocity(self, state):
        if state.now > 2.0:
            raise ZeroDivisionError("a plugin's mistake")
        return STOP

    def is_goal_reached(self, state, tolerance=None):
        return False


class Dying(Throwing):
    """A controller that ends its process."""

    def compute_velocity(self, state):
        import os

        os._exit(9)


class Hanging(Throwing):
    """A controller that never answers."""

    def compute_velocity(self, state):
        while True:
            pass


class Undecided(Throwing):
    """A controller that divides nothing by nothing, as NumPy does without a word."""

    def compute_velocity(self, state):
        return Twist2D(float("nan"), 0.0, 0.0)


class Slow(Throwing):
    """A controller with a parameter of its own: straight ahead."""

    @dataclass(frozen=True)
    class Parameters(ParameterSet):
        """Parameters of it."""

        pace: float = parameter(0.15, "how fast", unit="m/s")

    def compute_velocity(self, state):
        return Twist2D(self.parameters.pace, 0.0, 0.0)


class Trembling(Throwing):
    """A controller that draws from the generators of all the process, as most code of researchers does."""

    def compute_velocity(self, state):
        return Twist2D(0.15 + 0.02 * np.random.randn(), 0.0, random.uniform(-0.1, 0.1))


class Forgetful(Layer):
    """A layer with a mistake in it."""

    def update_bounds(self, context, window):
        return {}["size"]

    def update_costs(self, costs, window):
        pass


class Never(Planner):
    """A planner that finds nothing, so that the robot stands."""

    def plan(self, costmap, start, goal, tolerance, cancelled):
        raise PlanningError(PlanOutcome.NO_PATH_FOUND, "it never finds one")
