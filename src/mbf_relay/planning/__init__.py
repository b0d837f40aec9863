"""Global planning: from where the robot stands to where it should be, over a costmap."""

PLANNERS = {
    "navfn/NavfnROS": "mbf_relay.planning.navfn.NavfnPlanner",
    "global_planner/GlobalPlanner": "mbf_relay.planning.global_planner.GlobalPlanner",
    "theta_star": "mbf_relay.planning.any_angle.AnyAnglePlanner",
}
"""Type names in parameter files and the classes that do that job here."""
