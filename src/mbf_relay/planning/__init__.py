"""Global planning: from where the robot stands to where it should be, over a costmap."""

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
"""Type names in parameter files and the classes that do that job here; a former name stands for the present one."""
