"""Robots without a map: their goals are given in a frame in which they know where they are."""

from types import SimpleNamespace

import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.ros.web.robot import ViewedRobot
from mbf_relay.view.parameters import WebViewParameters
from mbf_relay.view.wishes import Refused, Wish


def robot(has_map, pose):
    """Return a robot of which this much is known, and where it was sent."""
    made, sent = ViewedRobot.__new__(ViewedRobot), []
    made.namespace, made._settings, made._tour = "/", WebViewParameters(), None
    made.view = SimpleNamespace(has_map=has_map, pose=pose, tells_status=True)
    made.hands = SimpleNamespace(goal=lambda goal, _has_action: sent.append(goal))
    return made, sent


@pytest.mark.parametrize("has_map, pose", [(True, None), (False, Pose2D(1.0, 0.0, 0.0))], ids=["map", "pose"])
def test_a_place_that_means_something_is_a_goal(has_map, pose):
    """A robot that drives by odometry alone was sent nowhere from the page."""
    made, sent = robot(has_map, pose)
    made.do(None, Wish("goal", {"x": 2.0, "y": 1.0, "theta": 0.0}))
    assert sent == [Pose2D(2.0, 1.0, 0.0)]


def test_a_place_that_means_nothing_is_none():
    made, sent = robot(False, None)
    with pytest.raises(Refused, match="no map .*frame 'map'"):
        made.do(None, Wish("goal", {"x": 2.0, "y": 1.0, "theta": 0.0}))
    assert sent == []
