"""A map that says it lies elsewhere than where it is used is told of: the robot would look for its walls in vain."""

import threading
import types

import numpy as np
import pytest
import rospy

from mbf_relay.costmap.factory import build_costmap
from mbf_relay.geometry import IDENTITY
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.amcl import map_client
from mbf_relay.ros.common.conversions import map_to_message
from mbf_relay.ros.costmap.inputs import MapInput

ROOM = OccupancyMap(np.zeros((20, 20), dtype=np.int8), 0.05, IDENTITY)


@pytest.fixture
def said(monkeypatch):
    lines = []
    monkeypatch.setattr(rospy, "logwarn", lambda text, *values: lines.append(text % values))
    monkeypatch.setattr(rospy, "Subscriber", lambda *_args, **_values: None)
    return lines


def map_in(frame):
    return map_to_message(ROOM, frame, 0.0)


def costmap_input(layer="static", **values):
    costmap = build_costmap("global_costmap", {
        "global_frame": "map", "robot_radius": 0.1, "plugins": [
            {"name": name, "type": "costmap_2d::StaticLayer"} for name in ("static", "another")],
        **values})
    return MapInput(layer, costmap.layers[0].map_source, costmap, lambda: None, threading.Lock())


@pytest.mark.parametrize("frame", ["odom", ""])
def test_localization_says_so_as_upstream_s_does(said, frame, monkeypatch):
    map_client.warn_of_frame(map_in(frame), "map")
    service = types.SimpleNamespace(map=map_in(frame))
    monkeypatch.setattr(map_client, "_look_for_service", lambda name: None)
    monkeypatch.setattr(rospy, "wait_for_service", lambda *_args, **_values: None)
    monkeypatch.setattr(rospy, "ServiceProxy", lambda *_args: lambda: service)
    monkeypatch.setattr(map_client, "check_map", lambda occupancy: None)
    map_client.request_map("map")
    assert len(said) == 2 and all(f"frame '{frame}', not in global_frame_id 'map'" in line for line in said)


@pytest.mark.parametrize("frame, layer, words, lies", [
    ("odom", "static", "used as if it were in 'map'", "map"), ("", "static", "used as if it were in 'map'", "map"),
    ("odom", "another", "placed by their transform", "odom"), ("", "another", "used as if it were in 'map'", "map"),
])
def test_a_costmap_says_so_once(said, frame, layer, words, lies):
    """One that takes its size of the map lies where that does: no transform between the two is looked for."""
    given = costmap_input(layer)
    for _ in range(2):
        given._take_map(map_in(frame))
    assert len(said) == 1 and words in said[0]
    assert given.frame == lies


@pytest.mark.parametrize("frame, values", [("map", {}), ("/map", {}), ("map", {"global_frame": "odom"})])
def test_maps_where_they_belong_are_taken_without_a_word(said, frame, values):
    given = costmap_input(rolling_window=bool(values), **values)
    given._take_map(map_in(frame))
    map_client.warn_of_frame(map_in(frame), "map")
    assert said == [] and given.frame == "map"
