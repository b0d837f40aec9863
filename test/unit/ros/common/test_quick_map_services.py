"""Maps in answers to services are written as one block, and are the messages they stand for, byte by byte."""

import io
import tracemalloc

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid
from nav_msgs.srv import GetMapResponse, LoadMapResponse

from mbf_relay.geometry import Pose2D
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.amcl import map_client
from mbf_relay.ros.common.conversions import map_to_message
from mbf_relay.ros.common.quick_map_services import QuickLoadResponse, QuickMapResponse
from mbf_relay.ros.map_server import node as map_server


def written(message):
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def map_of(height, width):
    cells = np.random.default_rng(0).choice(np.array([-1, 0, 100], np.int8), (height, width))
    return map_to_message(OccupancyMap(cells, 0.05, Pose2D(-1.0, 0.0, 0.5)), "map", 1.0)


def plain(grid):
    return OccupancyGrid(grid.header, grid.info, grid.data.tolist())


def test_bytes_are_the_same_both_ways():
    grid = map_of(5, 7)
    expected = written(GetMapResponse(plain(grid)))
    assert written(QuickMapResponse(grid)) == expected
    assert written(QuickLoadResponse(grid, 2)) == written(LoadMapResponse(plain(grid), 2))
    read = QuickMapResponse().deserialize(expected).map
    assert read.data.tolist() == grid.data.tolist()
    assert (read.header, read.info) == (grid.header, GetMapResponse().deserialize(expected).map.info)


@pytest.fixture
def served(monkeypatch):
    """Return what a map_server would answer with, and have amcl's proxy read it from the wire."""
    server = map_server.MapServer.__new__(map_server.MapServer)
    server._lock, server._message = map_server.threading.Lock(), map_of(1000, 1000)

    def proxy(_name, kind):
        return lambda: kind._response_class().deserialize(written(server._give(None)))

    monkeypatch.setattr(map_client.rospy, "ServiceProxy", proxy)
    monkeypatch.setattr(map_client.rospy, "wait_for_service", lambda *_, **__: None)
    monkeypatch.setattr(map_client.rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(map_client, "_look_for_service", lambda _: None)
    return server._message


def test_a_large_map_reaches_amcl_in_little_more_memory_than_its_cells(served):
    """map_server took 2.6 GiB for one of 8000 x 8000 cells, and went from robots with less, when amcl asked for it."""
    tracemalloc.start()
    try:
        taken = map_client.request_map("map")
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert (taken.data.ravel() == served.data).all()
    assert most < 8 * served.data.size
