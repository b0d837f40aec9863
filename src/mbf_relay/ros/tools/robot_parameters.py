"""robot_parameters.py: print the parameters with which the package's nodes drive another robot than the burger."""

from __future__ import annotations

import argparse
import sys
from typing import Any, Dict, Mapping, Optional, Sequence

import yaml

from mbf_relay import files
from mbf_relay.lockstep.command import without_remappings
from mbf_relay.lockstep.fitting import SERVER, fitted
from mbf_relay.lockstep.settings import Settings, load_settings
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.robot import DIFFERENTIAL, FOOTPRINT_FRAME, SCAN_FRAME, RobotModel
from mbf_relay.simulation.robot_file import load_robot

DIGITS = 4
"""Decimals of derived values."""
SCANS_MISSED = 3.0
"""Scan periods without a scan after which velocity_guard stops the robot, as for the burger."""


def parameters_for(robot: RobotModel) -> Dict[str, Any]:
    """Return a robot's parameters that differ from the package's files, by node, as launch files take `overrides`."""
    before = load_settings(files.config_folder())
    after = fitted(before, robot)
    limits = SimulationParameters.from_mapping({**before["simulator"], **robot.settings, "robot": "burger"})
    guard = dict(
        footprint=robot.footprint.tolist(), acc_lim_x=limits.wheel_acceleration,
        wheel_separation=robot.wheels.separation if robot.drive == DIFFERENTIAL else 0.0,
    )
    if limits.scan_rate > 0.0:
        guard["scan_timeout"] = SCANS_MISSED / limits.scan_rate
    _name_frames(robot, after, guard)
    nodes = {node: _changes(before[node], after[node]) for node in (SERVER, "amcl")}
    return {**{node: changes for node, changes in nodes.items() if changes}, "velocity_guard": guard}


def _name_frames(robot: RobotModel, settings: Settings, guard: Dict[str, Any]) -> None:
    """Set the frame names of a robot's description in all nodes' parameters."""
    base, scan = robot.frames.get("base_frame", FOOTPRINT_FRAME), robot.frames.get("scan_frame", SCAN_FRAME)
    settings["amcl"]["base_frame_id"] = settings[SERVER]["robot_frame"] = base
    if base != FOOTPRINT_FRAME:
        guard["base_frame"] = base
    for side in ("global_costmap", "local_costmap"):
        settings[SERVER][side]["robot_base_frame"] = base
        settings[SERVER][side]["scan"]["sensor_frame"] = scan


def _changes(before: Mapping[str, Any], after: Mapping[str, Any]) -> Dict[str, Any]:
    """Return the values of `after` that are not in `before` or differ there, groups recursively."""
    changed: Dict[str, Any] = {}
    for name, value in after.items():
        if isinstance(value, Mapping):
            value = _changes(before.get(name, {}), value)
            if value:  # roslaunch drops empty groups
                changed[name] = value
        elif name not in before or before[name] != value:
            changed[name] = round(value, DIGITS) if isinstance(value, float) else value
    return changed


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Print the parameters for a robot; return the exit status: 0, or 1 for an error of the user's."""
    parser = argparse.ArgumentParser(
        prog="robot_parameters.py", description="Print navigation's parameters for a robot, by node, for overrides:=.")
    parser.add_argument(
        "robot", metavar="ROBOT",
        help="name of a file in config/robot without its ending, or a robot's .yaml or .urdf file")
    robot = parser.parse_args(without_remappings(sys.argv[1:] if arguments is None else arguments)).robot
    try:
        print(yaml.safe_dump(parameters_for(load_robot(robot)), default_flow_style=None, sort_keys=False), end="")
    except (ValueError, OSError) as error:
        print(f"robot_parameters.py: {error}", file=sys.stderr)
        return 1
    return 0
