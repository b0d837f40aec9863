"""Obstacles that people set down from browsers, who come and go."""

from types import SimpleNamespace

import pytest
from visualization_msgs.msg import Marker, MarkerArray

from mbf_relay.ros.web import readers
from mbf_relay.ros.web.hands import Hands


class World:
    """The simulator's obstacles: markers by their namespace and number."""

    def __init__(self):
        self.standing = {}

    def hands(self):
        """Return new hands, as of a page that nobody looked at for a while."""
        hands = Hands("/", "map", lambda _words: None)
        hands._publishers["simulator/set_obstacles"] = SimpleNamespace(
            get_num_connections=lambda: 1, publish=self.take)
        return hands

    def take(self, message):
        for marker in message.markers:
            if marker.action == Marker.ADD:
                self.standing[marker.ns, marker.id] = marker
            else:
                self.standing.pop((marker.ns, marker.id), None)

    @property
    def told(self):
        """The simulator's message of what stands."""
        return MarkerArray([Marker(action=Marker.DELETEALL), *self.standing.values()])


@pytest.fixture
def world(monkeypatch):
    monkeypatch.setattr("rospy.Time", lambda *_: None)
    made = World()
    made.take(MarkerArray([Marker(ns="another's", id=1)]))
    return made


def places(world):
    return sorted(marker.pose.position.x for (name, _), marker in world.standing.items() if name != "another's")


def test_an_obstacle_stays_where_it_was_set_down_when_another_is_after_a_while(world):
    """After five seconds without a viewer the next one took the first one's place."""
    for x in (1.0, 2.0):
        world.hands().set_obstacle(x, 0.0, 0.3)
    assert places(world) == [1.0, 2.0]


def test_what_was_set_down_can_be_taken_away_by_any_page_and_after_any_while(world):
    """What was set down before nobody looked stood until the simulated world began anew."""
    world.hands().set_obstacle(1.0, 0.0, 0.3)
    told = readers.set_down(world.told)
    hands = world.hands()
    hands.set_obstacle(2.0, 0.0, 0.3)  # of which the simulator has not told yet
    hands.remove_obstacles(told)
    assert places(world) == [] and len(world.standing) == 1, "another's stays"
