"""Costmaps that rest while nobody needs them: not too soon, not too long, and what they had seen as it is asked for."""

import math
from types import SimpleNamespace

import pytest

from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.ros.server.costmap_rest import CostmapRest

RESTFUL = NavigatorParameters(shutdown_costmaps=True, shutdown_costmaps_delay=5.0)


class PaperNode:
    """A costmap's node that notes what it is told."""

    def __init__(self):
        self.rests, self.cleared = False, 0
        self.costmap = SimpleNamespace(clear=self._clear)

    def _clear(self):
        self.cleared += 1

    def rest(self):
        self.rests = True

    def resume(self):
        self.rests = False


def rested(clear=False):
    """Return costmaps that rest, what lets them, and at what time (s)."""
    nodes = {"global": PaperNode(), "local": PaperNode()}
    rest = CostmapRest(nodes, clear)
    assert rest.attend(10.0, True, RESTFUL) == 15.0 and rest.attend(14.0, True, RESTFUL) == 15.0
    assert not any(node.rests for node in nodes.values()), "a robot that pauses between two goals waits for none"
    assert rest.attend(15.0, True, RESTFUL) == math.inf and all(node.rests for node in nodes.values())
    return nodes, rest


def test_costmaps_rest_a_while_after_the_last_goal_and_are_there_for_the_next_one():
    nodes, rest = rested()
    assert rest.attend(20.0, True, RESTFUL) == math.inf
    assert rest.attend(21.0, False, RESTFUL) == math.inf and not any(node.rests for node in nodes.values())
    assert rest.attend(30.0, True, RESTFUL) == 35.0, "counted from the end of this goal, not of the one before"


def test_who_asks_about_a_costmap_wakes_it_for_as_long_as_a_goal_would():
    nodes, rest = rested()
    assert rest.wake() and not any(node.rests for node in nodes.values()) and not rest.wake()
    assert rest.attend(18.0, True, RESTFUL) == 23.0
    assert not rest.wake() and rest.attend(22.0, True, RESTFUL) == 27.0


@pytest.mark.parametrize("clear", [False, True])
def test_what_was_seen_is_forgotten_at_rest_only_where_that_is_asked_for(clear):
    nodes, _ = rested(clear)
    assert [node.cleared for node in nodes.values()] == [clear, clear]


def test_who_switches_resting_off_has_the_costmaps_work_again():
    nodes, rest = rested()
    assert rest.attend(16.0, True, RESTFUL.replace(shutdown_costmaps=False)) == math.inf
    assert not any(node.rests for node in nodes.values())
