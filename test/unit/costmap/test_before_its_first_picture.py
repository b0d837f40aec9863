"""A costmap in which there is nothing yet, and what is said to who plans on it."""

import numpy as np

from mbf_relay.costmap.factory import build_costmap
from mbf_relay.geometry import IDENTITY
from mbf_relay.maps import OccupancyMap
from mbf_relay.outcomes import PlanOutcome

STATIC = {"plugins": [{"name": "static", "type": "costmap_2d::StaticLayer"}]}


def test_a_costmap_without_a_first_picture_says_what_it_waits_for():
    costmap = build_costmap("global_costmap", STATIC)
    trouble = costmap.planning_trouble(0.0)
    assert trouble.outcome is PlanOutcome.NOT_INITIALIZED
    assert trouble.message == "global_costmap was not updated yet: no map has come on topic 'map'"
    costmap.update(0.0, IDENTITY)
    assert costmap.planning_trouble(0.0).outcome is PlanOutcome.MAP_ERROR


def test_a_goal_that_fails_for_want_of_a_pose_says_which_transform_is_missing():
    """It said that the costmap was not updated yet, and the log nothing: warnings wait for graphs that come up."""
    costmap = build_costmap("global_costmap", {"plugins": []})
    costmap.note_failure("no transform from 'base_link' to 'map'")
    said = "global_costmap was not updated yet: no transform from 'base_link' to 'map'"
    assert costmap.planning_trouble(0.0).message == costmap.stale_reason(0.0) == said
    costmap.update(0.0, IDENTITY)
    costmap.note_failure("no transform from 'base_link' to 'map'")
    assert costmap.planning_trouble(0.5) is None
    assert "last updated 9.00 s ago" in (late := costmap.stale_reason(9.0)) and "no transform" in late


def test_no_plan_leads_through_the_walls_of_a_map_that_has_just_come():
    costmap = build_costmap("global_costmap", STATIC)
    costmap.update(0.0, IDENTITY)
    costmap.set_map(OccupancyMap(np.full((20, 20), 100, dtype=np.int8), 0.05, IDENTITY))
    assert costmap.planning_trouble(0.0) is not None
    costmap.update(0.1, IDENTITY)
    assert costmap.planning_trouble(0.1) is None and (costmap.snapshot().costs == 254).all()
