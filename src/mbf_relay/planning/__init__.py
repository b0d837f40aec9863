"""Global planning: from where the robot stands to where it should be, over a costmap."""

PLANNERS = {
    "navfn/NavfnROS": "mbf_relay.planning.navfn.NavfnPlanner",
    "global_planner/GlobalPlanner": "mbf_relay.planning.global_planner.GlobalPlanner",
}
"""Type names in parameter files and the classes that do that job here."""
