"""What the server's services answer of a costmap that there is nothing in yet."""

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import PointStamped
from mbf_msgs import srv
from std_srvs.srv import EmptyRequest

from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.observation import Observation
from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.maps import OCCUPIED, OccupancyMap
from mbf_relay.ros.server import costmap_services

LOCAL, GLOBAL = 1, 2
FREE, LETHAL = 0, 2
WALL = OccupancyMap(np.full((40, 40), OCCUPIED, dtype=np.int8), 0.05, Pose2D(-1.0, -1.0, 0.0))


class PaperNode:
    """A costmap that is updated when somebody asks for it, where the robot knows its pose."""

    def __init__(self, name, layers, frame):
        self.costmap = build_costmap(
            name, {"global_frame": frame, "robot_radius": 0.1, "width": 4.0, "height": 4.0, "plugins": layers})
        self.has_pose = True

    def resume(self):
        if self.has_pose:
            self.costmap.update(10.0, IDENTITY)


@pytest.fixture
def nodes():
    static = [{"name": "static", "type": "costmap_2d::StaticLayer"}]
    return {"local": PaperNode("local_costmap", [], "odom"), "global": PaperNode("global_costmap", static, "map")}


@pytest.fixture
def ask(monkeypatch, nodes):
    """Asks what lies at the origin of a costmap's frame."""
    handlers = {}
    monkeypatch.setattr(rospy, "Service", lambda name, _kind, handler: handlers.update({name: handler}))
    monkeypatch.setattr(rospy, "logwarn", lambda *_arguments: None)
    monkeypatch.setattr(rospy, "get_time", lambda: 10.0)
    monkeypatch.setattr(costmap_services, "UPDATE_TIMEOUT", 0.05)
    services = costmap_services.CostmapServices(nodes, None, "base", lambda: False)

    def state(costmap):
        point = PointStamped()
        point.header.frame_id = {LOCAL: "odom", GLOBAL: "map"}[costmap]
        return handlers["~check_point_cost"](srv.CheckPointRequest(point=point, costmap=costmap)).state

    state.update = lambda: handlers["~update_costmaps"](EmptyRequest())
    state.clear = lambda: handlers["~clear_costmaps"](EmptyRequest())
    state.kept = services
    return state


def test_a_pillar_is_not_told_to_be_free_before_the_costmap_has_it(nodes, ask):
    """Who asked as soon as the services were there was sent into it: a costmap begins free all over."""
    nodes["global"].has_pose = False
    with pytest.raises(rospy.ServiceException, match="global_costmap was not updated yet"):
        ask(GLOBAL)
    nodes["global"].has_pose = True
    with pytest.raises(rospy.ServiceException, match="no map"):
        ask(GLOBAL)
    nodes["global"].costmap.set_map(WALL)
    assert ask(GLOBAL) == LETHAL


def test_who_asks_about_the_local_costmap_waits_for_no_map(nodes, ask):
    nodes["global"].has_pose = False
    assert ask(LOCAL) == FREE
    with pytest.raises(rospy.ServiceException, match="the global costmap did not update"):
        ask.update()


def test_what_was_seen_long_ago_is_no_answer(nodes, ask, monkeypatch):
    assert ask(LOCAL) == FREE
    nodes["local"].has_pose = False
    monkeypatch.setattr(rospy, "get_time", lambda: 70.0)
    with pytest.raises(rospy.ServiceException, match="last updated 60"):
        ask(LOCAL)


def test_what_was_seen_and_has_gone_is_in_neither_costmap_that_is_told_to_clear(nodes, ask):
    seen = {"footprint_clearing_enabled": False, "observation_sources": "scan", "scan": {"marking": True}}
    for side, frame in (("local", "odom"), ("global", "map")):
        nodes[side].costmap = costmap = build_costmap(f"{side}_costmap", {
            "global_frame": frame, "robot_radius": 0.1, "width": 4.0, "height": 4.0,
            "plugins": [{"name": "seen", "type": "costmap_2d::ObstacleLayer"}], "seen": seen})
        for y in (0.0, 1.0):
            costmap.observe("scan", Observation((1.0, 0.0), np.array([(0.0, y)]), np.array([True]), 10.0), 10.0)
            costmap.update(10.0, IDENTITY)
    assert (ask(LOCAL), ask(GLOBAL)) == (LETHAL, LETHAL)
    ask.clear()
    for node in nodes.values():
        node.resume()
    assert (ask(LOCAL), ask(GLOBAL)) == (FREE, FREE)
