"""Parameters of the gymnasium environment, in a module that does not import gymnasium."""

from __future__ import annotations

from dataclasses import dataclass

from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class EnvironmentParameters(ParameterSet):
    """Parameters of `NavigationEnvironment`: rate of actions, observations and rewards."""

    control_rate: float = parameter(5.0, "actions per second of simulated time", unit="Hz", above=0.0)
    beams: int = parameter(
        36, "number of sectors of the scan; each gives its nearest reading", minimum=1, maximum=16384)
    goal_radius: float = parameter(
        0.3, "distance at which a goal of the circle counts as reached; worlds files give their own", unit="m",
        above=0.0)
    reward_progress: float = parameter(1.0, "reward per metre nearer to the goal, in a straight line")
    reward_goal: float = parameter(5.0, "reward for each goal reached")
    reward_contact: float = parameter(-5.0, "reward for a collision, which ends the episode")
    reward_time: float = parameter(-0.02, "reward per second")
