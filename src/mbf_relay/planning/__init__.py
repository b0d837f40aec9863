"""Global planning: paths from the robot's pose to a goal over a costmap."""

PLANNERS = {
    "carrot_planner/CarrotPlanner": "mbf_relay.planning.carrot.CarrotPlanner",
    "navfn/NavfnROS": "mbf_relay.planning.navfn.NavfnPlanner",
    "global_planner/GlobalPlanner": "mbf_relay.planning.global_planner.GlobalPlanner",
    "any_angle": "mbf_relay.planning.any_angle.AnyAnglePlanner",
    "theta_star": "any_angle",
    **dict.fromkeys(
        (
            "SBPLLatticePlanner",
            "sbpl_lattice_planner/SBPLLatticePlanner",
            "voronoi_planner/VoronoiPlanner",
            "relaxed_astar/RAstarPlannerROS",
        ),
        "mbf_relay.planning.stand_ins.NavfnStandIn",
    ),
}
"""The class that implements each planner type which parameter files may name; a former name maps to the present one."""
