"""~make_plan's requests and answers, and whom they are passed on to."""

import threading
from types import SimpleNamespace

import pytest
import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from mbf_msgs.msg import GetPathResult
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlanRequest

from mbf_relay.ros.common.actions.client_goals import ActionEnding
from mbf_relay.ros.relay import services
from mbf_relay.ros.relay.server_side import RemoteServer
from mbf_relay.ros.relay.services import PLAN_SLOT, MakePlan, append_goal, path_goal


def pose(x, frame="map", w=1.0):
    result = PoseStamped()
    result.header.frame_id, result.pose.position.x, result.pose.orientation.w = frame, x, w
    return result


def test_an_empty_start_frame_means_the_robots_pose():
    assert not path_goal(GetPlanRequest(start=pose(0.0, ""), goal=pose(1.0)), "").use_start_pose
    assert path_goal(GetPlanRequest(start=pose(0.0), goal=pose(1.0)), "").use_start_pose


def test_quaternions_that_callers_leave_zero_become_the_identity_and_others_stay():
    goal = path_goal(GetPlanRequest(start=pose(0.0, w=0.0), goal=pose(1.0, w=0.5), tolerance=0.3), "navfn")
    assert (goal.start_pose.pose.orientation.w, goal.target_pose.pose.orientation.w) == (1.0, 0.5)
    assert (goal.tolerance, goal.planner) == (pytest.approx(0.3), "navfn")


def test_it_plans_beside_the_servers_own_planning():
    assert path_goal(GetPlanRequest(), "").concurrency_slot == PLAN_SLOT != 0


def test_a_plan_that_stops_short_ends_with_the_goal():
    plan = Path(poses=[pose(0.0), pose(0.9)])
    append_goal(plan, pose(1.0))
    assert [p.pose.position.x for p in plan.poses] == [0.0, 0.9, 1.0]
    append_goal(plan, pose(1.0))
    assert len(plan.poses) == 3


def test_an_empty_plan_stays_empty_and_frames_are_not_mixed():
    plan = Path()
    append_goal(plan, pose(1.0))
    assert plan.poses == []
    plan = Path(poses=[pose(0.0)])
    append_goal(plan, pose(1.0, frame="odom"))
    assert len(plan.poses) == 1


def test_a_relay_whose_server_is_remapped_sends_goals_where_it_says_it_does(monkeypatch):
    """It told of the remapped server, read its parameters, and waited for the action of the one by the old name."""
    monkeypatch.setitem(rospy.names.get_resolved_mappings(), "/move_base_flex", "/robot1/server")
    assert RemoteServer().relay_parameters({}).server == "/robot1/server"


@pytest.fixture
def make_plan(monkeypatch):
    """Return what asks for a plan to 1 m of a server that has its action alone, and what was called off by then."""
    monkeypatch.setattr(services, "_is_served", lambda service: False)

    def answered(ending, adds_goal=True, called_off=None):
        made = MakePlan.__new__(MakePlan)
        values = SimpleNamespace(make_plan_add_unreachable_goal=adds_goal)
        made._settings = SimpleNamespace(plugin_names=lambda: ("navfn",), values=values)
        made._server, made._one_at_a_time = "/move_base_flex", threading.Lock()
        sent = SimpleNamespace(wait=lambda patience: ending, cancel=lambda: called_off.append(True))
        made._client = SimpleNamespace(wait_for_server=lambda patience: True, send=lambda goal: sent)
        return [each.pose.position.x for each in made._answer(GetPlanRequest(goal=pose(1.0))).plan.poses]

    return answered


def test_a_plan_of_a_server_that_has_its_action_alone_ends_with_the_goal_where_that_is_asked_for(make_plan):
    def ending(status):
        return ActionEnding(status, "", GetPathResult(path=Path(poses=[pose(0.0), pose(0.9)])))

    assert make_plan(ending(GoalStatus.SUCCEEDED)) == [0.0, 0.9, 1.0]
    assert make_plan(ending(GoalStatus.SUCCEEDED), adds_goal=False) == [0.0, 0.9]
    assert make_plan(ending(GoalStatus.ABORTED)) == [], "what was found before it failed leads nowhere"


def test_a_plan_that_nobody_waits_for_any_more_is_called_off(make_plan):
    called_off = []
    with pytest.raises(rospy.ServiceException, match="no plan within 60 s"):
        make_plan(None, called_off=called_off)
    assert called_off


def test_why_a_server_was_lost_meanwhile_is_told_to_who_asked_for_a_plan(make_plan):
    with pytest.raises(rospy.ServiceException, match="no plan: died"):
        make_plan(ActionEnding(GoalStatus.LOST, "died: its node closed the connection"))
