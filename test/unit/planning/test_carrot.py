"""The carrot planner goes straight, and as near as the robot fits."""

import tracemalloc

import numpy as np
import pytest

from mbf_relay.costmap.cost_grid import LETHAL, CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.grid import Grid
from mbf_relay.outcomes import PlanningError
from mbf_relay.planning import PLANNERS
from mbf_relay.planning.planner import Cancellation, Planner
from mbf_relay.plugins import create

SQUARE = np.array([[-0.2, -0.2], [-0.2, 0.2], [0.2, 0.2], [0.2, -0.2]])


def plan(goal, blocked=None, start=Pose2D(1.0, 1.0, 0.0)):
    costs = np.zeros((60, 60), np.uint8)
    if blocked is not None:
        costs[blocked] = LETHAL
    costmap = CostGrid(Grid(0.1, 0.0, 0.0, 60, 60), costs, "odom", SQUARE, 0.2, 0.29)
    planner = create("CarrotPlanner", "carrot_planner/CarrotPlanner", {}, Planner, PLANNERS)
    return planner.plan(costmap, start, goal, 0.0, Cancellation())


def test_a_free_goal_is_reached_in_its_heading():
    path = plan(Pose2D(4.0, 3.0, 2.0))
    assert tuple(path.poses[0, :2]) == (1.0, 1.0)
    assert path.poses[-1] == pytest.approx((4.0, 3.0, 2.0))
    assert path.length == pytest.approx(np.hypot(3.0, 2.0))


def test_a_goal_in_a_wall_is_approached_until_the_footprint_would_touch():
    path = plan(Pose2D(4.5, 1.0, 0.0), blocked=np.s_[:, 40:50])
    assert 3.6 <= path.poses[-1, 0] <= 3.8


def test_a_goal_off_the_costmap_is_approached_to_its_edge():
    assert 5.0 < plan(Pose2D(9.0, 1.0, 0.0)).poses[-1, 0] <= 5.9


def test_poses_in_utm_coordinates_take_no_gigabytes():
    tracemalloc.start()
    try:
        assert plan(Pose2D(9e5, 1.0, 0.0)).poses[-1, 0] > 5.6
        with pytest.raises(PlanningError, match="the start .* lies outside"):
            plan(Pose2D(1.0, 1.0, 0.0), start=Pose2D(9e5, 1.0, 0.0))
        assert tracemalloc.get_traced_memory()[1] < 10e6
    finally:
        tracemalloc.stop()


def test_a_robot_that_fits_nowhere_on_the_line_is_told():
    with pytest.raises(PlanningError, match="nowhere on the line"):
        plan(Pose2D(4.0, 1.0, 0.0), blocked=np.s_[:, 8:])


def test_sbpl_is_stood_in_for_and_says_so():
    planner = create("SBPL", "SBPLLatticePlanner", {"primitive_filename": "mir.mprim"}, Planner, PLANNERS)
    assert len(planner.notes) == 1 and "SBPLLatticePlanner is not available here" in planner.notes[0]
    assert planner.parameters.unknown_names({"primitive_filename": "mir.mprim"}) == []


def test_a_turn_two_centimetres_from_where_the_robot_stands_is_planned():
    path = plan(Pose2D(1.02, 1.0, 1.5))
    assert path.poses[-1] == pytest.approx((1.02, 1.0, 1.5))
