"""The parameters of the node move_base, by its names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List

from mbf_relay.parameters import ParameterSet, parameter, without_effect

OTHER_MOVE_BASE_NAMES: List[str] = [
    "recovery_behaviors",
    "clearing_radius",
    "aggressive_reset_distance",
    "restore_defaults",
]
"""Further names that move_base reads and that mean nothing here."""


@dataclass(frozen=True)
class MoveBaseParameters(ParameterSet):
    """The parameters of the node move_base, with its defaults."""

    base_global_planner: str = parameter("navfn/NavfnROS", "type of the global planner")
    base_local_planner: str = parameter("base_local_planner/TrajectoryPlannerROS", "type of the local planner")
    planner_frequency: float = parameter(
        0.0, "rate of replanning; 0 to plan only for a new goal or when the controller fails", unit="Hz", minimum=0.0,
        maximum=100.0)
    controller_frequency: float = parameter(20.0, "rate of the control loop", unit="Hz", minimum=0.0, maximum=100.0)
    planner_patience: float = parameter(
        5.0, "time without a valid plan before recovery", unit="s", minimum=0.0, maximum=100.0)
    controller_patience: float = parameter(
        5.0, "time without a valid velocity before recovery; 15 if no file gives it and the executable move_base is "
        "run", unit="s", minimum=0.0, maximum=100.0)
    max_planning_retries: int = parameter(
        -1, "how often planning is retried before recovery; -1 for no limit", minimum=-1, maximum=1000)
    conservative_reset_dist: float = parameter(
        3.0, "side of the square around the robot outside which the first recovery clears the costmaps", unit="m",
        minimum=0.0, maximum=50.0)
    recovery_behavior_enabled: bool = parameter(True, "run recovery behaviours")
    clearing_rotation_allowed: bool = parameter(True, "turn in place as a recovery")
    shutdown_costmaps: bool = parameter(False, "stop updating the costmaps while there is no goal")
    oscillation_timeout: float = parameter(
        0.0, "time of oscillation before recovery; 0 to switch the check off", unit="s", minimum=0.0, maximum=60.0)
    oscillation_distance: float = parameter(
        0.5, "distance the robot must move not to count as oscillating", unit="m", minimum=0.0, maximum=10.0)
    make_plan_clear_costmap: bool = without_effect(True, "make_plan plans in the costmap as it is")
    make_plan_add_unreachable_goal: bool = parameter(
        True, "append the goal to make_plan's plan even if the plan ends short of it")
