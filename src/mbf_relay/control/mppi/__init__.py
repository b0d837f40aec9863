"""Model predictive path integral control: many noisy trajectories are sampled, and their weighted mean is driven."""

CRITICS = {
    "ConstraintCritic": "mbf_relay.control.mppi.motion_critics.ConstraintCritic",
    "CostCritic": "mbf_relay.control.mppi.place_critics.CostCritic",
    "GoalCritic": "mbf_relay.control.mppi.place_critics.GoalCritic",
    "GoalAngleCritic": "mbf_relay.control.mppi.place_critics.GoalAngleCritic",
    "ObstaclesCritic": "mbf_relay.control.mppi.place_critics.ObstaclesCritic",
    "PathAlignCritic": "mbf_relay.control.mppi.path_critics.PathAlignCritic",
    "PathAngleCritic": "mbf_relay.control.mppi.path_critics.PathAngleCritic",
    "PathFollowCritic": "mbf_relay.control.mppi.path_critics.PathFollowCritic",
    "PreferForwardCritic": "mbf_relay.control.mppi.motion_critics.PreferForwardCritic",
    "TwirlingCritic": "mbf_relay.control.mppi.motion_critics.TwirlingCritic",
    "VelocityDeadbandCritic": "mbf_relay.control.mppi.motion_critics.VelocityDeadbandCritic",
}
"""Names in the parameter `critics`, as in Nav2, and the classes they stand for."""
