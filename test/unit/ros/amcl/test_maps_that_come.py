"""What amcl does with the maps that come, whoever sends them, and with where it is told to start on the first."""

import threading
from types import SimpleNamespace

import numpy as np
import pytest

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.amcl import node as amcl
from mbf_relay.ros.common.conversions import map_to_message

PLACE = Pose2D(1.0, 2.0, 0.5)


def room(side):
    data = np.zeros((side, side), dtype=np.int8)
    data[:1] = data[-1:] = data[:, :1] = data[:, -1:] = 100
    return OccupancyMap(data, 0.05, IDENTITY)


@pytest.fixture
def node(monkeypatch):
    """An amcl of paper, whose kept pose the master has."""
    made = amcl.AmclNode.__new__(amcl.AmclNode)
    made._parameters, made._lock = AmclParameters(first_map_only=True, use_map_topic=True), threading.RLock()
    made._rng, made._localizer, made._pending_pose = np.random.default_rng(1), None, None
    made._map_to_odom, made._start_anywhere = SimpleNamespace(configure=lambda *_: None), False
    made._covariance = np.diag([1e-4, 1e-4, 1e-4])
    made._saved_pose = SimpleNamespace(load=lambda: (PLACE, made._covariance, None))
    for name in ("loginfo", "logwarn"):
        monkeypatch.setattr(f"rospy.{name}", lambda *_: None)
    return made


def test_of_two_maps_that_come_together_the_first_alone_is_taken(node, monkeypatch):
    """The second was taken, too: it looked whether there was one before the first was read."""
    read = amcl.map_from_message

    def read_while_another_comes(message):
        monkeypatch.setattr(amcl, "map_from_message", read)
        node._take_map(map_to_message(room(100), "map", 0.0))
        return read(message)

    monkeypatch.setattr(amcl, "map_from_message", read_while_another_comes)
    node._take_map(map_to_message(room(120), "map", 0.0))
    assert node._localizer.field.occupancy.data.shape == (100, 100)


@pytest.mark.parametrize("come", [
    lambda node: node._take_map(map_to_message(room(100), "map", 0.0)),
    lambda node: node._set_map(SimpleNamespace(map=map_to_message(room(100), "map", 0.0), initial_pose=None)),
], ids=["topic", "service"])
def test_nobody_waits_for_amcl_while_its_master_hangs(node, monkeypatch, come):
    """Who sent a pose or looked at its diagnostics waited as well."""
    held = []

    def look():
        held.append(not node._lock.acquire(timeout=0.01))
        if not held[-1]:
            node._lock.release()

    def load():
        other = threading.Thread(target=look)
        other.start()
        other.join(20.0)
        return PLACE, node._covariance, None

    node._saved_pose = SimpleNamespace(load=load)
    node._read_pose = lambda _message: (PLACE, node._covariance)
    come(node)
    assert held and not any(held) and np.allclose(node._localizer.poses.mean(axis=0), PLACE, atol=0.05)
