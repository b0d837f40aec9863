"""Launch files in the shapes of users' robots, as written for move_base, amcl and map_server: names and values only."""

import re
from pathlib import Path

FOLDER = Path(__file__).parent / "launch_files"
NAMES = sorted(path.stem for path in FOLDER.glob("*.launch"))
ARGUMENTS = {"initial_pose_x": "-1.990", "initial_pose_y": "-0.508"}
"""Where the robot is believed to stand at first, for the files that ask."""
SERVERS = {"flex": "/move_base_flex", "fleet": "/robot1/move_base", "other_name": "/move_base_node"}
"""Nodes that plan and drive, where they are called otherwise than /move_base."""
OURS = re.compile(r'pkg="(?:move_base|amcl|fake_localization|map_server)"')


def swapped_into(folder):
    """Write the files into a folder with another `pkg` each, as a user would who has this package, and return it."""
    for path in FOLDER.rglob("*.*"):
        copy = folder / path.relative_to(FOLDER)
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_text(OURS.sub('pkg="mbf_relay"', path.read_text(encoding="utf-8")), encoding="utf-8")
    return folder


def arguments_of(name, map_file):
    """Return the arguments of a launch file: its map and where the robot stands, where it has such."""
    text = (FOLDER / f"{name}.launch").read_text(encoding="utf-8")
    return {key: value for key, value in {**ARGUMENTS, "map_file": map_file}.items() if f'<arg name="{key}"' in text
            and "include file=\"$(dirname)/outdoor.launch\"" not in text}
