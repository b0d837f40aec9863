"""drive_report.py: make a report of a recorded drive."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys
from io import BytesIO
from typing import List, Optional, Sequence

from mbf_relay.report import page, picture
from mbf_relay.report.drive import Drive
from mbf_relay.ros.tools.drive_events import read_bag, robots_in
from mbf_relay.whole_files import write_whole


def main(arguments: Optional[Sequence[str]] = None) -> None:
    """Read a bag and write report.json, report.png and report.html; exit with 1 and one line on an error."""
    parser = argparse.ArgumentParser(
        description="Make a report (report.json, report.png, report.html) of a recorded drive. The bag needs tf; map, "
        "scan, odom, cmd_vel, plans, ground_truth and the goals and results of move_base or move_base_flex are shown "
        "where it has them."
    )
    parser.add_argument("bag", help="the bag file")
    parser.add_argument(
        "--namespace", metavar="NAME", default="", help="namespace of the robot, if the bag has several")
    parser.add_argument("--out", metavar="DIR", help="folder for the report (default: beside the bag)")
    options = parser.parse_args(arguments)
    try:
        drive, topics = read_bag(options.bag, options.namespace)
    except OSError as error:
        sys.exit(f"bag {options.bag} cannot be read: {error.strerror}")
    except ValueError as error:
        sys.exit(str(error))
    if not len(drive.path):
        robots = robots_in(options.bag)
        sys.exit(
            f"{options.bag} shows no drive: it needs /tf with map -> odom and odom -> the robot's base, or "
            f"ground_truth; found {', '.join(topics) or 'nothing known'}"
            + (f"; choose a robot by --namespace, of {', '.join(robots)}" if robots else "")
        )
    drive.versions = {"python": platform.python_version(), "bag": os.path.basename(options.bag)}
    folder = options.out or os.path.dirname(os.path.abspath(options.bag))
    try:
        paths = write_report(drive, folder)
    except OSError as error:
        sys.exit(f"the report cannot be written: {error}")
    print("\n".join(paths))


def write_report(drive: Drive, folder: str) -> List[str]:
    """Write the three files of a report into a folder, which is created if missing; return their paths.

    Raises:
        OSError: A file cannot be written; those before it have been.
    """
    os.makedirs(folder, exist_ok=True)
    paths = [os.path.join(folder, f"report.{ending}") for ending in ("json", "png", "html")]
    write_whole(paths[0], json.dumps(drive.summary(), indent=2) + "\n")
    drawn = BytesIO()
    picture.draw(drive, drawn)
    write_whole(paths[1], drawn.getvalue())
    page.write(drive, paths[2], drawn.getvalue())
    return paths
