"""robot_description.py: print a simulated robot's URDF, for robot_state_publisher and RViz."""

from __future__ import annotations

import argparse
import sys
from typing import Optional, Sequence

from mbf_relay import files
from mbf_relay.lockstep.command import without_remappings
from mbf_relay.simulation.description import urdf_of
from mbf_relay.simulation.robot_file import load_robot


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Print the URDF of a robot; return the exit status: 0, or 1 for an error of the user's."""
    parser = argparse.ArgumentParser(prog="robot_description.py", description="Print a robot's URDF.")
    parser.add_argument(
        "robot", metavar="ROBOT",
        help="name of a file in config/robot without its ending, or a robot's .yaml or .urdf file (printed as it is)"
    )
    robot = parser.parse_args(without_remappings(sys.argv[1:] if arguments is None else arguments)).robot
    try:
        print(files.read_text(robot) if robot.endswith(".urdf") else urdf_of(load_robot(robot)))
    except (ValueError, OSError) as error:
        print(f"robot_description.py: {error}", file=sys.stderr)
        return 1
    return 0
