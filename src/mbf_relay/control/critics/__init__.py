"""Critics of DWA: each scores a batch of trajectories by one criterion, or rules trajectories out."""

CRITICS = {
    "oscillation": "mbf_relay.control.critics.oscillation.Oscillation",
    "foresight": "mbf_relay.control.critics.foresight.ForesightCost",
    "obstacle": "mbf_relay.control.critics.obstacle.ObstacleCost",
    "goal_front": "mbf_relay.control.critics.distances.GoalFront",
    "alignment": "mbf_relay.control.critics.distances.Alignment",
    "path": "mbf_relay.control.critics.distances.PathDistance",
    "goal": "mbf_relay.control.critics.distances.GoalDistance",
    "heading": "mbf_relay.control.critics.distances.Heading",
    "twirling": "mbf_relay.control.critics.motion.Twirling",
    "prefer_forward": "mbf_relay.control.critics.motion.PreferForward",
    "slow": "mbf_relay.control.critics.motion.Slow",
    "counter_steering": "mbf_relay.control.critics.motion.CounterSteering",
    "steady": "mbf_relay.control.critics.motion.Steady",
}
"""Names in the parameter `critics` and the classes they stand for."""
