"""The map_server node: loads a map from a file, publishes it latched and returns it by service."""

from __future__ import annotations

import os
import sys
import threading
from typing import Sequence

import rospy
from nav_msgs.msg import MapMetaData, OccupancyGrid
from nav_msgs.srv import GetMap, LoadMap, LoadMapRequest, LoadMapResponse

from mbf_relay.maps import (
    MapFileError,
    MapFileParameters,
    MapImageError,
    OccupancyMap,
    load_map,
    load_map_image,
    read_map_file,
)
from mbf_relay.ros.common.conversions import map_to_message
from mbf_relay.ros.common.diagnostics import OK, Diagnostics, Report
from mbf_relay.ros.common.node import spare_what_stays
from mbf_relay.ros.common.quick_map_services import QuickLoadResponse, QuickMapResponse
from mbf_relay.ros.common.rospy_patches.receiving import look_at_clock_seldom

USAGE = "usage: map_server MAP.yaml (or, deprecated: map_server IMAGE RESOLUTION)"


class MapServer:
    """Serves one map at a time under map_server's names: `map`, `map_metadata`, `static_map`, `change_map`."""

    def __init__(self, occupancy: OccupancyMap) -> None:
        self._frame = str(rospy.get_param("~frame_id", "map"))
        self._folder = str(rospy.get_param("~map_folder", ""))
        self._lock = threading.Lock()  # guards _message: rospy runs each service call in its own thread
        self._map_publisher = rospy.Publisher("map", OccupancyGrid, queue_size=1, latch=True)
        self._metadata_publisher = rospy.Publisher("map_metadata", MapMetaData, queue_size=1, latch=True)
        self._publish(occupancy)
        rospy.Service("static_map", GetMap, self._give)
        rospy.Service("change_map", LoadMap, self._change)
        Diagnostics().add("map", self._report)

    def _publish(self, occupancy: OccupancyMap) -> None:
        message = map_to_message(occupancy, self._frame, rospy.get_rostime())
        with self._lock:
            self._message = message
            self._metadata_publisher.publish(message.info)
            self._map_publisher.publish(message)
        height, width = occupancy.data.shape
        rospy.loginfo("serving a map of %d x %d cells of %.3f m", width, height, occupancy.resolution)

    def _report(self) -> Report:
        with self._lock:
            info = self._message.info
        values = {
            "cells": f"{info.width} x {info.height}", "resolution [m]": f"{info.resolution:.3f}",
            "subscribers": self._map_publisher.get_num_connections(),
        }
        return OK, "serving a map", values

    def _give(self, _request: object) -> QuickMapResponse:
        with self._lock:
            return QuickMapResponse(self._message)

    def _change(self, request: LoadMapRequest) -> LoadMapResponse:
        path = request.map_url[len("file://"):] if request.map_url.startswith("file://") else request.map_url
        if self._folder and not is_below(path, self._folder):
            return self._refuse(
                LoadMapResponse.RESULT_MAP_DOES_NOT_EXIST,
                f"{path} does not lie below {self._folder}, which parameter ~map_folder allows")
        try:
            occupancy = load_map(path)
        except OSError as error:
            return self._refuse(LoadMapResponse.RESULT_MAP_DOES_NOT_EXIST, error)
        except MapImageError as error:
            return self._refuse(LoadMapResponse.RESULT_INVALID_MAP_DATA, error)
        except MapFileError as error:
            return self._refuse(LoadMapResponse.RESULT_INVALID_MAP_METADATA, error)
        self._publish(occupancy)
        with self._lock:
            return QuickLoadResponse(self._message, LoadMapResponse.RESULT_SUCCESS)

    @staticmethod
    def _refuse(result: int, error: object) -> LoadMapResponse:
        rospy.logerr("the map was not changed: %s", error)
        return LoadMapResponse(result=result)


def is_below(path: str, folder: str) -> bool:
    """Return whether a file lies below a folder, with links resolved; of a map's YAML file, its image must too."""
    root = os.path.realpath(folder)
    paths = [os.path.realpath(path)]
    try:
        paths.append(os.path.realpath(os.path.join(os.path.dirname(paths[0]), read_map_file(paths[0]).image)))
    except (OSError, ValueError):
        pass  # load_map reports what is wrong with it
    return all(os.path.commonpath((root, found)) == root for found in paths)


def check_arguments(arguments: Sequence[str]) -> None:
    """Raise ValueError where there are not one or two arguments."""
    if len(arguments) not in (1, 2):
        raise ValueError(f"{len(arguments)} arguments given; {USAGE}")


def read_arguments(arguments: Sequence[str]) -> OccupancyMap:
    """Load the map given on the command line.

    A second argument beside a YAML file is ignored with a warning if it is no number; the tutorials' launch file has
    one.

    Raises:
        ValueError: The number of arguments is wrong, or the map's files are invalid.
        OSError: A file cannot be read.
    """
    check_arguments(arguments)
    path, given = arguments[0], arguments[-1]
    if len(arguments) == 1:
        return load_map(path)
    resolution = _number(given)
    if not resolution:
        try:
            occupancy = load_map(path)
        except MapFileError as error:
            raise MapFileError(f"resolution '{given}' is no number above 0, and {error}") from error
        rospy.logwarn("'%s' is no resolution and is ignored: the map's YAML file has one", given)
        return occupancy
    rospy.logwarn("naming a map by an image and a resolution is deprecated; give its YAML file instead")
    values = dict(rospy.get_param("~", {}) or {})
    values.update(image=path, resolution=resolution, mode="trinary")
    if values.get("negate") in (0, 1):
        values["negate"] = bool(values["negate"])
    return load_map_image(path, MapFileParameters.from_mapping(values))


def _number(text: str) -> float:
    """Return a text as a number, 0 where it is none, as atof in map_server does."""
    try:
        return float(text)
    except ValueError:
        return 0.0


def main() -> None:
    """Serve the map given on the command line until ROS shuts down."""
    look_at_clock_seldom()
    server = MapServer(read_arguments(rospy.myargv(sys.argv)[1:]))
    spare_what_stays()
    rospy.spin()
    del server
