"""Whether an action server is there: what is asked, and of whom, when it falls silent."""

from types import SimpleNamespace

import pytest

from mbf_relay.ros.common import server_watch
from mbf_relay.ros.common.server_watch import GONE, THERE, ServerWatch

NODE = "/move_base_flex"


class Link(SimpleNamespace):
    """A connection to a node that publishes the status."""

    def __init__(self, address):
        super().__init__(callerid_pub=NODE, endpoint_id=address)


class Subscriber:
    """Has the connections it is given."""

    def __init__(self, topic, kind, callback, **_):
        self.impl = SimpleNamespace(connections=[])
        self.callback = callback

    def get_num_connections(self):
        return len(self.impl.connections)

    def hear(self):
        """Deliver a status message."""
        self.callback(SimpleNamespace(_connection_header={"callerid": NODE}))


@pytest.fixture
def world(monkeypatch):
    """A watch whose clock is `world.now` and whose living nodes are `world.alive`."""
    world = SimpleNamespace(now=100.0, alive=set(), asked=[])

    def ask(node, address="", timeout=0.0):
        world.asked.append(address)
        return THERE if address in world.alive else GONE

    monkeypatch.setattr(server_watch.rospy, "Subscriber", Subscriber)
    monkeypatch.setattr(server_watch.rospy, "get_rostime", lambda: SimpleNamespace(to_sec=lambda: world.now))
    monkeypatch.setattr(server_watch, "time", SimpleNamespace(monotonic=lambda: world.now))
    monkeypatch.setattr(server_watch, "ask_node", ask)
    world.watch = ServerWatch("move_base_flex/move_base", lambda node: True, 5.0, lambda message: None)
    world.links = world.watch._subscriber.impl.connections
    return world


def test_a_server_that_was_started_again_is_not_lost_for_the_death_of_the_one_before(world):
    world.alive.add("http://here:1")
    world.links.append(Link("http://here:1"))
    world.watch._subscriber.hear()
    world.alive = {"http://here:2"}
    world.links[:] = [Link("http://here:2")]
    world.now += 10.0  # nobody looked meanwhile, and the new one has not said anything yet
    assert world.watch.why_lost(world.now) is None
    world.now += 1.0
    assert world.watch.why_lost(world.now) is None
    assert world.asked == ["http://here:2"]


def test_a_server_that_died_is_lost_though_its_connection_seems_to_stand(world):
    world.alive.add("http://here:1")
    world.links.append(Link("http://here:1"))
    world.watch._subscriber.hear()
    world.alive.clear()
    world.now += 1.0
    assert "does not exist any more" in world.watch.why_lost(world.now)
    assert not world.watch.is_up
