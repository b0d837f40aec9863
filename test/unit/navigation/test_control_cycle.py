"""A cycle of a controller: where a robot has arrived."""

import numpy as np
import pytest
import scripted

from mbf_relay.control.state import ControlState, GoalTolerance
from mbf_relay.geometry import STOP, Pose2D
from mbf_relay.navigation.control_cycle import run_cycle
from mbf_relay.navigation.goals import FollowGoal
from mbf_relay.outcomes import ControlOutcome
from mbf_relay.planning.path import Path

AT_GOAL, SHORT = Pose2D(1.0, 0.0, 0.0), Pose2D(0.8, 0.0, 0.0)


@pytest.mark.parametrize("expected, now, arrived", [
    (AT_GOAL, AT_GOAL, True), (AT_GOAL, None, True), (AT_GOAL, SHORT, False), (SHORT, AT_GOAL, False),
])
def test_a_robot_has_arrived_where_it_is_and_is_expected_to_stay(expected, now, arrived):
    script = scripted.new_script()
    script.reached = lambda state: state.pose.distance_to(AT_GOAL) < 0.1
    controller = scripted.ScriptedController("C1", {})
    state = ControlState(1.0, expected, STOP, scripted.PaperCostmap("odom").snapshot(), pose_now=now)
    path = Path(np.array([SHORT, AT_GOAL]), "odom")
    assert run_cycle(controller, state, path, True, None).arrived == arrived
    assert script.paths == [(path, True)]


@pytest.mark.parametrize("given", [(0.0, 0.0), (0.1, 0.0), (0.0, 0.2)])
def test_no_robot_drives_past_its_goal_for_a_tolerance_that_nobody_filled_in(make_bench, given):
    bench = make_bench(mbf_tolerance_check=True, dist_tolerance=0.1, angle_tolerance=0.2)
    goal = FollowGoal(scripted.straight_path(), tolerance=GoalTolerance(*given))
    result = bench.finish(bench.navigator.exe_path(goal))
    assert result.outcome is ControlOutcome.SUCCESS and result.distance == pytest.approx(0.09, abs=0.02)
