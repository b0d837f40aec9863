"""Layers of one's own that break off in the middle of an update."""

import re

import numpy as np
import pytest

from mbf_relay.costmap import factory
from mbf_relay.costmap.cost_grid import EMPTY, LETHAL, Window
from mbf_relay.costmap.layer import Layer
from mbf_relay.costmap.observation import Observation
from mbf_relay.geometry import IDENTITY
from mbf_relay.plugins import PluginFailure

VALUES = {
    "global_frame": "odom", "update_frequency": 10.0, "rolling_window": True, "width": 3, "height": 3,
    "robot_radius": 0.1,
    "plugins": [
        {"name": "obstacles", "type": "costmap_2d::ObstacleLayer"},
        {"name": "mine", "type": f"{__name__}.HalfWrittenLayer"},
        {"name": "inflation", "type": "costmap_2d::InflationLayer"},
    ],
    "obstacles": {"observation_sources": "scan", "scan": {"obstacle_range": 3.0}},
}


class HalfWrittenLayer(Layer):
    """A user's own, which breaks off as the test says."""

    broken = ""

    def update_bounds(self, context, window):
        if self.broken == "bounds":
            return None
        return window

    def update_costs(self, costs, window):
        costs[window.slices] = LETHAL if self.broken == "costs" else costs[window.slices]
        if self.broken == "costs":
            {}["scan"]


@pytest.mark.parametrize("broken, words", [
    ("bounds", r"layer 'mine' failed with TypeError: .* not NoneType"),
    ("costs", r"layer 'mine' failed with KeyError: 'scan' \(test_layers_that_fail\.py, line \d+\)"),
])
def test_an_obstacle_stays_where_a_layer_of_one_s_own_breaks_off_and_whoever_asks_hears_which(broken, words):
    costmap = factory.build_costmap("local_costmap", VALUES)
    mine = costmap.layer("mine")
    mine.broken = broken
    with pytest.raises(PluginFailure, match=words):
        costmap.update(0.0, IDENTITY)
    assert re.search(f"not updated yet: {words}", costmap.stale_reason(0.0))
    mine.broken = ""
    costmap.update(0.1, IDENTITY)
    empty = costmap.snapshot()
    costmap.observe("scan", Observation((0.0, 0.0), np.array([[1.0, 0.0]]), None, 0.2))
    mine.broken = broken
    with pytest.raises(PluginFailure):
        costmap.update(0.2, IDENTITY)
    assert np.array_equal(costmap.snapshot().costs, empty.costs)
    assert re.search(f"at most 1.00 s is allowed: {words}", costmap.stale_reason(9.0))
    assert re.search(words, costmap.planning_trouble(9.0).message)
    mine.broken = ""
    costmap.update(0.3, IDENTITY)
    seen = costmap.snapshot()
    column, row = seen.grid.cell_at(1.0, 0.0)
    assert seen.costs[row, column] == LETHAL and (seen.costs == LETHAL).sum() == 1 and costmap.stale_reason(0.3) is None


class OwnWindowLayer(Layer):
    """A user's own, which tells of its own cells alone."""

    window = EMPTY

    def update_bounds(self, context, window):
        return self.window

    def update_costs(self, costs, window):
        pass


@pytest.mark.parametrize("window", [EMPTY, Window(1, 1, 3, 3)])
def test_no_robot_runs_into_what_its_lidar_sees_because_a_layer_of_one_s_own_tells_of_its_own_cells_alone(window):
    mine = {"name": "mine", "type": f"{__name__}.OwnWindowLayer"}
    costmap = factory.build_costmap("local_costmap", {**VALUES, "plugins": [VALUES["plugins"][0], mine]})
    costmap.layer("mine").window = window
    costmap.update(0.0, IDENTITY)
    costmap.observe("scan", Observation((0.0, 0.0), np.array([[1.0, 0.0]]), None, 0.1))
    costmap.update(0.1, IDENTITY)
    seen = costmap.snapshot()
    column, row = seen.grid.cell_at(1.0, 0.0)
    assert seen.costs[row, column] == LETHAL
    costmap.observe("scan", Observation((0.0, 0.0), np.array([[1.0, 0.0], [0.0, 1.0]]), None, 0.2))
    costmap.update(0.2, IDENTITY)
    seen = costmap.snapshot()
    column, row = seen.grid.cell_at(0.0, 1.0)
    assert seen.costs[row, column] == LETHAL
