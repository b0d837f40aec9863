"""Recovery behaviours: what to do when there is no path or no velocity."""

RECOVERIES = {
    "clear_costmap_recovery/ClearCostmapRecovery": "mbf_relay.recovery.clear_costmap.ClearCostmap",
    "rotate_recovery/RotateRecovery": "mbf_relay.recovery.rotate.Rotate",
    "move_slow_and_clear/MoveSlowAndClear": "mbf_relay.recovery.move_slow.MoveSlowAndClear",
    "back_up": "mbf_relay.recovery.back_up.BackUp",
    "wait": "mbf_relay.recovery.wait.Wait",
}
"""Type names in parameter files and the classes that do that job here."""
