"""Recovery behaviours: what to do when there is no path or no velocity."""

RECOVERIES = {
    "clear_costmap_recovery/ClearCostmapRecovery": "mbf_relay.recovery.clear_costmap.ClearCostmap",
    "rotate_recovery/RotateRecovery": "mbf_relay.recovery.rotate.Rotate",
    "move_slow_and_clear/MoveSlowAndClear": "mbf_relay.recovery.move_slow.MoveSlowAndClear",
    "back_up": "mbf_relay.recovery.back_up.BackUp",
    **dict.fromkeys(
        (
            "step_back_and_max_steer_recovery/StepBackAndMaxSteerRecovery",
            "stepback_and_steerturn_recovery/StepBackAndSteerTurnRecovery",
        ),
        "mbf_relay.recovery.step_back.StepBack",
    ),
    "wait": "mbf_relay.recovery.wait.Wait",
}
"""Classes by their type names in parameter files: upstream's, and this package's own."""
