"""Local planners: the velocity that follows the path and avoids the obstacles of the local costmap."""

CONTROLLERS = {
    "base_local_planner/TrajectoryPlannerROS": "mbf_relay.control.trajectory_planner.TrajectoryPlanner",
    "dwa_local_planner/DWAPlannerROS": "mbf_relay.control.dwa.DwaController",
    "dwb_local_planner/DWBLocalPlanner": "mbf_relay.control.stand_ins.DwbStandIn",
    "eband_local_planner/EBandPlannerROS": "mbf_relay.control.stand_ins.EBandStandIn",
    "mpc_local_planner/MpcLocalPlannerROS": "mbf_relay.control.stand_ins.MpcStandIn",
    "mppi": "mbf_relay.control.mppi.controller.MppiController",
    "nav2_mppi_controller/MPPIController": "mbf_relay.control.mppi.controller.MppiController",
    "neo_local_planner/NeoLocalPlanner": "mbf_relay.control.stand_ins.NeoStandIn",
    "pose_follower/PoseFollower": "mbf_relay.control.stand_ins.PoseFollowerStandIn",
    "regulated_pure_pursuit_controller/RegulatedPurePursuitController":
        "mbf_relay.control.pure_pursuit.RegulatedPurePursuit",
    "regulated_pure_pursuit": "mbf_relay.control.pure_pursuit.RegulatedPurePursuit",
    "teb_local_planner/TebLocalPlannerROS": "mbf_relay.control.stand_ins.TebStandIn",
}
"""Types of local planners in parameter files, and the classes that take their place here."""
