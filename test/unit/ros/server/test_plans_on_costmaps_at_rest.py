"""A plan that is asked for while the costmaps rest, as exploration does between two goals."""

import sys
from pathlib import Path

import pytest
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.srv import GetPlanRequest

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "navigation"))

import scripted
from scripted_bench import Bench

from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.ros.server import plan_services
from mbf_relay.ros.server.costmap_rest import CostmapRest
from mbf_relay.ros.server.costmap_services import CostmapServices


class RestingNode:
    """A costmap that is stale while it rests, and is updated where it need not any more."""

    def __init__(self, costmap):
        self.costmap, self.has_pose = costmap, True
        costmap.updates = 1

    def rest(self):
        self.costmap.trouble = PlanningError(PlanOutcome.MAP_ERROR, "it was last updated 60.00 s ago")

    def resume(self):
        if self.has_pose:
            self.costmap.updates, self.costmap.trouble = self.costmap.updates + 1, None


@pytest.fixture
def handlers():
    """What answers each service."""
    return {}


@pytest.fixture
def nodes(monkeypatch, handlers):
    monkeypatch.setattr(rospy, "Service", lambda name, _kind, handler: handlers.update({name: handler}))
    monkeypatch.setattr(rospy, "logwarn", lambda *_arguments: None)
    monkeypatch.setattr(rospy, "get_time", lambda: 1000.0)
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time(1000))
    monkeypatch.setattr("mbf_relay.ros.server.costmap_services.UPDATE_TIMEOUT", 0.05)
    bench = Bench(shutdown_costmaps=True, shutdown_costmaps_delay=0.0)
    made = {side: RestingNode(costmap) for side, costmap in bench.costmaps.items()}
    for node in made.values():
        node.costmap.stale_reason = lambda now: "it was not updated"
    rest = CostmapRest(made, clear=False)
    rest.attend(999.0, True, bench.navigator.parameters)
    services = CostmapServices(made, None, "base", rest.wake)
    plan_services.PlanServices(bench.navigator, rouse=services.rouse)
    return made


def plan(handlers):
    request = GetPlanRequest()
    request.goal = PoseStamped()
    request.goal.header.frame_id, request.goal.pose.position.x = "map", 1.0
    return handlers["~make_plan"](request).plan.poses


def test_a_plan_is_made_on_a_costmap_that_rested(nodes, handlers):
    assert nodes["global"].costmap.trouble is not None
    assert len(plan(handlers)) == len(scripted.straight_path())


def test_there_is_none_where_the_robot_s_pose_is_lost_meanwhile(nodes, handlers):
    nodes["global"].has_pose = False
    assert plan(handlers) == []
