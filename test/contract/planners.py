"""The planners that the contract suites hold to it."""

from mbf_relay import plugins
from mbf_relay.planning import PLANNERS
from mbf_relay.planning.planner import Cancellation, Planner

CASES = {
    "navfn": ("navfn/NavfnROS", {}),
    "global_planner": ("global_planner/GlobalPlanner", {}),
    "global_planner by the grid": ("global_planner/GlobalPlanner", {"use_grid_path": True, "use_quadratic": False}),
    "any angle": ("any_angle", {}),
}


def made(case, **changes):
    type_name, values = CASES[case]
    return plugins.create("planner", type_name, {**values, **changes}, Planner, PLANNERS)


def plan(planner, costmap, start, goal, tolerance=0.0, cancelled=None):
    return planner.plan(costmap, start, goal, tolerance, cancelled or Cancellation())
