"""A clock that is set back, as by a simulation or a recording that begins anew, makes nothing seen before it young."""

import numpy as np
import pytest
from test_costmap import NEW_FORM

from mbf_relay.costmap import factory
from mbf_relay.costmap.cost_grid import LETHAL
from mbf_relay.costmap.observation import Observation
from mbf_relay.geometry import IDENTITY

NOTHING = np.zeros((0, 2))


@pytest.fixture
def costmap():
    """One that was fed and updated at 1000 s."""
    made = factory.build_costmap("local_costmap", NEW_FORM)
    made.observe("scan", Observation((0.0, 0.0), NOTHING, None, 1000.0))
    made.update(1000.0, IDENTITY)
    assert made.stale_reason(1000.2) is None
    return made


@pytest.mark.parametrize("now", [999.99, 999.5])  # another thread's look, which began a moment earlier
def test_a_look_that_began_before_an_update_finds_it_fresh(costmap, now):
    assert costmap.stale_reason(now) is None and costmap.planning_trouble(now) is None


def test_nobody_drives_or_plans_on_a_costmap_of_before_time_was_set_back(costmap):
    assert costmap.stale_reason(5.0) == "local_costmap was last updated before time was set back"
    assert "set back" in costmap.planning_trouble(5.0).message
    costmap.update(5.0, IDENTITY)
    assert costmap.planning_trouble(5.1) is None


def test_nobody_drives_by_a_lidar_that_has_sent_nothing_since_time_was_set_back(costmap):
    costmap.update(5.0, IDENTITY)
    assert costmap.stale_reason(5.1) == (
        "local_costmap: lidar source 'scan' on topic 'scan' sent nothing since time was set back")
    costmap.observe("scan", Observation((0.0, 0.0), NOTHING, None, 5.2))
    costmap.update(5.2, IDENTITY)
    assert costmap.stale_reason(5.3) is None


def test_no_ghost_of_before_time_was_set_back_stands_where_a_sensor_looks_through():
    lasting = {**NEW_FORM["obstacles"]["scan"], "observation_persistence": 10.0}
    obstacles = {**NEW_FORM["obstacles"], "scan": lasting}
    costmap = factory.build_costmap("local_costmap", {**NEW_FORM, "obstacles": obstacles})

    def seen(x, now):
        costmap.observe("scan", Observation((0.0, 0.0), np.array([[x, 0.0]]), None, now))
        costmap.update(now, IDENTITY)
        snapshot = costmap.snapshot()
        column, row = snapshot.grid.cell_at(0.5, 0.0)
        return snapshot.costs[row, column] == LETHAL

    assert seen(0.5, 1000.0) and seen(1.2, 1001.0), "what a sensor saw lasts"
    assert not seen(1.2, 5.0)
