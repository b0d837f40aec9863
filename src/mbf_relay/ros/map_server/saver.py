"""The map_saver node: waits for a map on the topic `map` and writes it as an image and a YAML file."""

from __future__ import annotations

import argparse
import sys
from typing import Optional, Sequence

import rospy
from nav_msgs.msg import OccupancyGrid

from mbf_relay.maps import save_map
from mbf_relay.ros.common.conversions import map_from_message


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="map_saver", description="Write the map on the topic 'map' to NAME.pgm and NAME.yaml."
    )
    parser.add_argument(
        "-f", dest="name", metavar="NAME", default="map",
        help="path of the files to write, without ending (default map)")
    parser.add_argument(
        "--occ", type=int, default=65, help="cells of at least this value, 1 to 100, are occupied (default 65)")
    parser.add_argument(
        "--free", type=int, default=25, help="cells of at most this value, 0 to 100, are free (default 25)")
    return parser


USAGE = make_parser().format_help()


def wait_for_map() -> Optional[OccupancyGrid]:
    """Return the first message on `map`, with a warning every 10 s while there is none; None at shutdown."""
    while not rospy.is_shutdown():
        try:
            return rospy.wait_for_message("map", OccupancyGrid, timeout=10.0)
        except rospy.ROSException:
            rospy.logwarn("no map on %s yet; is a map server or a mapping node running?", rospy.resolve_name("map"))
    return None


def check_arguments(arguments: Sequence[str]) -> argparse.Namespace:
    """Return the options of the command line; raise ValueError unless 0 <= free < occ <= 100."""
    options = make_parser().parse_args(arguments)
    if not 0 <= options.free < options.occ <= 100:
        raise ValueError(f"--occ is {options.occ} and --free is {options.free}; they must be 0 <= free < occ <= 100")
    return options


def main() -> None:
    """Save one map and end."""
    options = check_arguments(rospy.myargv(sys.argv)[1:])
    rospy.loginfo("waiting for a map on %s", rospy.resolve_name("map"))
    message = wait_for_map()
    if message is None:
        return
    yaml_path, image_path = save_map(options.name, map_from_message(message), options.occ, options.free)
    rospy.loginfo("wrote %s and %s", yaml_path, image_path)
