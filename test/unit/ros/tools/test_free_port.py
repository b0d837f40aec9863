"""A port for a master of one's own."""

import random
import socket

import pytest

pytest.importorskip("psutil")

from mbf_relay.ros.tools import demo_graph  # noqa: E402


def test_a_node_that_looks_for_its_master_cannot_be_given_its_port():
    with open("/proc/sys/net/ipv4/ip_local_port_range", encoding="ascii") as stream:
        first, last = map(int, stream.read().split())
    assert not any(first <= demo_graph.free_port() <= last for _ in range(50))


def test_a_port_somebody_listens_on_is_not_taken(monkeypatch):
    with socket.socket() as listening:
        listening.bind(("127.0.0.1", demo_graph.free_port()))
        taken = listening.getsockname()[1]
        monkeypatch.setattr(demo_graph, "PORTS", (taken, taken + 100))
        monkeypatch.setattr(random.SystemRandom, "sample", lambda _self, ports, count: list(ports)[:count])
        assert taken < demo_graph.free_port() < taken + 100
