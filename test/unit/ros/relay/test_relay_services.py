"""~make_plan's requests and answers, and whom they are passed on to."""

import pytest
import rospy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from nav_msgs.srv import GetPlanRequest

from mbf_relay.ros.relay.server_side import RemoteServer
from mbf_relay.ros.relay.services import PLAN_SLOT, append_goal, path_goal


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
