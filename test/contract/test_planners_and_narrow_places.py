"""One suite over every planner: the room that paths leave a robot, and what is said where none is left."""

import os
import re
import sys

import numpy as np
import pytest

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from planners import CASES, made, plan  # noqa: E402

from mbf_relay.costmap.cost_grid import LETHAL, Window  # noqa: E402
from mbf_relay.costmap.costmap import Costmap  # noqa: E402
from mbf_relay.costmap.footprint_checker import FootprintChecker  # noqa: E402
from mbf_relay.costmap.inflation_layer import InflationLayer  # noqa: E402
from mbf_relay.costmap.layer import Layer  # noqa: E402
from mbf_relay.costmap.parameters import CostmapParameters  # noqa: E402
from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.outcomes import PlanningError, PlanOutcome  # noqa: E402
from mbf_relay.planning import PLANNERS  # noqa: E402
from mbf_relay.planning.planner import Planner  # noqa: E402
from mbf_relay.plugins import create  # noqa: E402


@pytest.fixture(params=sorted(CASES))
def planner(request):
    return made(request.param)


def walls_with_gaps(*gaps, width=0.29):
    """Return a snapshot at 0.02 m of three rooms in a row, with a robot this wide: a gap (m) in each wall between."""
    resolution, height = 0.02, 60
    costs = np.zeros((height, 60 * (len(gaps) + 1)), dtype=np.uint8)
    costs[[0, -1]] = costs[:, [0, -1]] = LETHAL
    for index, gap in enumerate(gaps):
        cells, column = round(gap / resolution), 60 * (index + 1)
        costs[:, column:column + 4] = LETHAL
        costs[30:30 + cells, column:column + 4] = 0
    return inflated(costs, resolution, width)


class Walls(Layer):
    """Walls as they are drawn."""

    def update_bounds(self, context, window):
        return Window.of(self.grid)

    def update_costs(self, costs, window):
        np.maximum(costs, self.parameters, out=costs)


def inflated(costs, resolution, width):
    """Return a snapshot as a costmap makes it, for a robot this wide whose base is near its front."""
    half, (height, length) = 0.5 * width, costs.shape
    costmap = Costmap("global_costmap", CostmapParameters.from_mapping({
        "width": length * resolution, "height": height * resolution, "resolution": resolution, "footprint_padding": 0.0,
        "footprint": [[-half, -half], [-half, half], [0.05, half], [0.05, -half]],
    }), [
        Walls("walls", costs),
        InflationLayer("inflation", InflationLayer.Parameters(inflation_radius=1.0, cost_scaling_factor=3.0)),
    ])
    costmap.update(1.0, Pose2D(0.4, 0.6, 0.0))
    return costmap.snapshot()


def test_a_path_round_the_end_of_a_wall_leaves_the_robot_room_to_turn(planner):
    """Paths kept as far off as the inscribed circle is wide: robots cut the corner and stood before it, wedged."""
    costs = np.zeros((100, 100), dtype=np.uint8)
    costs[:, 48:52] = LETHAL
    costs[40:, 48:52] = 0
    costmap = inflated(costs, 0.02, 0.2)
    path = plan(planner, costmap, Pose2D(0.5, 0.2, 1.5), Pose2D(1.5, 0.2, -1.5))
    clearances = FootprintChecker(costmap).clearances_at(path.poses)
    assert clearances.min() > costmap.circumscribed_radius


def test_of_two_gaps_the_robot_takes_the_one_it_fits_through_at_the_price_of_a_way_round(planner):
    costs = np.zeros((100, 100), dtype=np.uint8)
    costs[:, 48:52] = LETHAL
    costs[20:30, 48:52] = costs[45:65, 48:52] = 0
    path = plan(planner, inflated(costs, 0.02, 0.2), Pose2D(0.5, 0.5, 0.0), Pose2D(1.5, 0.5, 0.0))
    assert path.poses[:, 1].max() > 0.95


@pytest.mark.parametrize("gap", [0.02, 0.06, 0.08, 0.16, 0.18, 0.24])
def test_a_robot_wider_than_every_gap_is_told_where_and_how_wide_the_narrowest_place_is(planner, gap):
    costmap = walls_with_gaps(1.0, gap)
    with pytest.raises(PlanningError) as error:
        plan(planner, costmap, Pose2D(0.4, 0.6, 0.0), Pose2D(3.2, 0.6, 0.0))
    assert error.value.outcome is PlanOutcome.NO_PATH_FOUND
    said = re.search(r"narrowest place of the widest way, \((.*), (.*)\), is (.*) m wide; the robot needs 0.29 m",
                     error.value.message)
    assert said, error.value.message
    x, y, width = map(float, said.groups())
    assert 2.40 <= x <= 2.48 and 0.6 <= y <= 0.6 + gap, "the wall behind the second room"
    assert width == pytest.approx(gap, abs=0.005)


def test_a_robot_that_fits_and_one_that_is_walled_in_are_told_of_no_narrow_place(planner):
    assert len(plan(planner, walls_with_gaps(1.0, 0.4), Pose2D(0.4, 0.6, 0.0), Pose2D(3.2, 0.6, 0.0))) > 10
    with pytest.raises(PlanningError) as error:
        plan(planner, walls_with_gaps(1.0, 0.0), Pose2D(0.4, 0.6, 0.0), Pose2D(3.2, 0.6, 0.0))
    assert "narrowest" not in error.value.message


def test_of_two_gaps_too_narrow_the_wider_one_is_named(planner):
    costs = walls_with_gaps(1.0, 0.06).costs.copy()
    costs[costs < LETHAL] = 0
    costs[10:17, 120:124] = 0
    costmap = inflated(costs, 0.02, 0.29)
    with pytest.raises(PlanningError, match=r"\(2\.4\d, 0\.2\d\), is 0\.14 m wide"):
        plan(planner, costmap, Pose2D(0.4, 0.6, 0.0), Pose2D(3.2, 0.6, 0.0))


def test_a_robot_told_to_come_near_a_goal_that_is_blocked_ends_where_it_can_turn(planner):
    """Its centre fitted and its corners did not: it stood 3 cm before that place, told that its path was blocked."""
    costs = np.zeros((100, 100), dtype=np.uint8)
    costs[:, 60:] = LETHAL
    costmap = inflated(costs, 0.02, 0.2)
    path = plan(planner, costmap, Pose2D(0.4, 1.0, 0.0), Pose2D(1.22, 1.0, 0.7), tolerance=0.3)
    assert path.goal.theta == pytest.approx(0.7)
    checker = FootprintChecker(costmap)
    assert not checker.touches(np.array([(*path.goal[:2], heading) for heading in np.arange(0.0, 6.3, 0.05)])).any()
    assert path.goal.distance_to(Pose2D(1.22, 1.0, 0.0)) < 0.25, "and no farther off than it must be"


def test_a_robot_told_to_come_near_a_goal_in_a_corridor_it_cannot_turn_in_ends_where_it_fits(planner):
    costs = np.full((100, 100), LETHAL, dtype=np.uint8)
    costs[10:90, 5:50] = costs[44:56, 50:90] = 0  # a room, and a corridor of 0.24 m
    costmap = inflated(costs, 0.02, 0.2)
    goal = Pose2D(1.5, 1.12, 0.0)  # in its wall, and farther than the tolerance from the room
    path = plan(planner, costmap, Pose2D(0.4, 1.0, 0.0), goal, tolerance=0.3)
    assert not FootprintChecker(costmap).touches(np.array([path.goal])).any()
    assert path.goal.distance_to(goal) < 0.2


def test_a_goal_that_only_the_centre_of_the_robot_fits_on_is_missed_within_its_tolerance_alone(planner):
    costs = np.zeros((100, 100), dtype=np.uint8)
    costs[:, 60:] = LETHAL
    costmap = inflated(costs, 0.02, 0.2)
    beside, start = Pose2D(1.121, 1.001, 1.57), Pose2D(0.4, 1.0, 0.0)  # in the corner of its cell
    assert FootprintChecker(costmap).touches(np.array([beside])).all()
    near = plan(planner, costmap, start, beside, tolerance=0.2).goal
    assert not FootprintChecker(costmap).touches(np.array([near])).any()
    for tolerance in (0.01, 0.015):  # its own centre is farther off than that, or the nearest to it
        assert plan(planner, costmap, start, beside, tolerance=tolerance).goal == pytest.approx(beside)
    assert plan(planner, costmap, start, beside).goal == pytest.approx(beside)


def test_a_robot_told_to_come_near_a_goal_is_not_sent_round_to_the_other_side_of_its_wall(planner):
    """Beyond the wall is nearer: it looked for a way round from outside for as long as it had time."""
    costs = np.zeros((150, 100), dtype=np.uint8)
    costs[:130, 50:54] = LETHAL
    costmap = inflated(costs, 0.02, 0.2)
    path = plan(planner, costmap, Pose2D(0.6, 0.4, 0.0), Pose2D(1.07, 0.4, 0.0), tolerance=0.4)
    assert path.goal.x < 1.0 and path.length < 1.0


def test_a_robot_shut_in_by_costs_alone_hears_that_there_is_no_path():
    """No obstacle is as near as anything: the planner raised OverflowError while it looked for the narrowest place."""
    costs = np.zeros((60, 60), dtype=np.uint8)
    costs[:, 30] = 150
    shy = create("planner", "global_planner/GlobalPlanner", {"lethal_cost": 100}, Planner, PLANNERS)
    with pytest.raises(PlanningError) as refused:
        plan(shy, inflated(costs, 0.02, 0.2), Pose2D(0.3, 0.6, 0.0), Pose2D(0.9, 0.6, 0.0))
    assert refused.value.outcome is PlanOutcome.NO_PATH_FOUND


@pytest.mark.parametrize("x, y", [(-0.03, 0.3), (1.23, 0.3), (0.3, -0.03), (0.3, 1.23)])
def test_a_robot_a_little_beside_the_map_hears_that_there_is_no_path(planner, x, y):
    """Past the map's upper ends IndexError was raised, past the lower ones the place was looked for at the others."""
    costs = np.zeros((60, 60), dtype=np.uint8)
    costs[20:40, 20:40] = LETHAL
    costs[23:37, 23:37] = 0
    with pytest.raises(PlanningError) as refused:
        plan(planner, inflated(costs, 0.02, 0.1), Pose2D(x, y, 0.0), Pose2D(0.6, 0.6, 0.0))
    assert refused.value.outcome is PlanOutcome.NO_PATH_FOUND
