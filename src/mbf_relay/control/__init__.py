"""Local control: which velocity follows the path and stays clear of what the robot sees."""

CONTROLLERS = {
    "dwa_local_planner/DWAPlannerROS": "mbf_relay.control.dwa.DwaController",
    "regulated_pure_pursuit": "mbf_relay.control.pure_pursuit.RegulatedPurePursuit",
}
"""Type names in parameter files and the classes that do that job here."""
