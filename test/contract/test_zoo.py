"""Public robots' own parameters: each set loads, says only what is true and of use, and drives there and back."""

import pytest
from benchmark import report
from benchmark import zoo as benchmark
from contract import zoo
from tally import LONG

from mbf_relay.navigation.examination import CLAMPED, DOUBTFUL, IGNORED, REFUSED, STOOD_IN

UNREAD_UPSTREAM = {
    "acc_lim_Y", "allow_unknown", "alternative_goals_thresh",
    "cost_factor", "default_tolerance", "footprint_padding", "inflation_radius",
    "inflation_unknow", "last_plan_if_blocked", "lethal_cost",
    "lethal_cost_threshold", "mark_threshold", "max_in_place_vel_theta", "max_obstacle_height", "max_vel_rot",
    "max_vel_y", "meter_scoring",
    "min_obstacle_height", "min_vel_rot", "min_vel_y", "neutral_cost", "old_navfn_behavior", "orientation_mode",
    "orientation_window_size", "origin_z", "penalize_negative_x", "publish_observations", "publish_potential",
    "publish_voxel_map", "recovery_behaviour_enabled", "search_alternative_goals",
    "subscribe_to_updates", "unknown_cost_value",
    "unknown_threshold",
    "use_dijkstra", "use_grid_path", "use_quadratic", "visualize_hc_graph", "visualize_potential", "vtheta_samples",
    "vy_samples", "z_resolution", "z_voxels",
}
"""Names that the C++ components they stand under do not read either: misspelt, misplaced, or of others."""
WITHOUT_EFFECT_HERE = {"escape_reset_theta", "prune_plan", "publish_voxel_map", "unknown_threshold"}
"""Names that those read, and on which nothing here depends."""
INFLATED_TOO_LITTLE = ("limo_ackermann", "limo_diff", "ridgeback", "summit_xl_eband", "summit_xl_omni", "summit_xl_teb")
"""Robots whose files inflate obstacles by less than the inscribed radius of their own footprint."""
SEE_NOTHING = ("evarobot", "kobuki", "rosbot")
"""Robots whose files name no sensor for the local costmap's obstacles."""
PLANNED_FOR_A_SMALLER_ONE = ("evarobot",)
"""Robots whose files give the footprint to the global costmap alone."""
QUICK = ("dingo_o", "husky", "jackal", "limo_ackermann", "mir100", "turtlebot2", "turtlebot3_waffle")
DRIVEN = zoo.NAMES if LONG else QUICK
FIELD = 792003
"""The field that was the hardest of six, when robots were first driven through them."""
IN_A_FIELD = ("dashgo", "mir100", "summit_xl_eband")
"""Robots that stood there, or touched something."""
OFF_THEIR_COSTMAP = ("dingo_o", "quori", "rosbot", "xiaoqiang")
"""Robots whose files give the global costmap a size of its own, beyond which that field's goal lies."""
IT_STANDS = ("limo_ackermann", "turtlebot2")
"""Robots that do not get through: a car where it cannot turn, and one to which being near a thing outweighs all way."""
TOUCHES = ("evarobot",)
"""A robot that touches something: it sees nothing."""


def test_there_are_twenty_five_robots_and_more_of_every_kind_of_wheels():
    assert len(zoo.NAMES) >= 25
    assert {entry["drive"] for entry in zoo.SETS.values()} == {"differential", "omnidirectional", "car"}


@pytest.mark.parametrize("name", zoo.NAMES)
def test_it_loads_with_every_plugin_and_layer(name):
    found = zoo.examined(name)
    assert found.of(REFUSED) == []
    doubted = {finding.name.rpartition("/")[2] for finding in found.of(DOUBTFUL)}
    assert doubted == {parameter for parameter, names in (
        ("inflation_radius", INFLATED_TOO_LITTLE), ("observation_sources", SEE_NOTHING),
        ("footprint", PLANNED_FOR_A_SMALLER_ONE)) if name in names}
    assert found.config["controllers"] and found.config["planners"]


@pytest.mark.parametrize("name", zoo.NAMES)
def test_what_it_is_warned_of_is_true(name):
    parameters = zoo.SETS[name]["parameters"]
    found = zoo.examined(name)
    for finding in found.of(IGNORED):
        last = finding.name.rpartition("/")[2]
        assert last in UNREAD_UPSTREAM | WITHOUT_EFFECT_HERE or isinstance(parameters.get(finding.name), dict), finding
        used = {entry.name for entry in found.of("used")}
        assert finding.name not in used, finding
    for finding in found.of(CLAMPED, STOOD_IN):
        assert len(finding.text) > 15 and finding.name, finding


@pytest.mark.parametrize("name", zoo.NAMES)
def test_the_table_of_robots_has_it_and_says_what_it_is_warned_of(name):
    readme = (report.HERE / "README.md").read_text(encoding="utf-8")
    cells = [name, *map(str, benchmark.described(name).values()), "yes", "0"]
    assert f"\n| {' | '.join(cells)} | " in readme, "`scripts/benchmark zoo --write` writes the table"


@pytest.mark.parametrize("name", zoo.NAMES)
def test_its_footprint_and_limits_are_what_its_file_says(name):
    setup = zoo.setup_for(name)
    assert setup.robot.footprint.shape[0] >= 3
    assert abs(setup.robot.footprint).max() < 1.0 and setup.settings["simulator"]["max_speed"] < 3.5


@pytest.mark.parametrize("name", DRIVEN)
def test_it_drives_there_turns_and_comes_back(name):
    pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")
    from mbf_relay.lockstep.episode import Episode

    result = Episode(zoo.there_and_back(name), zoo.setup_for(name), seed=1).run()
    assert result.success and result.contacts == 0, f"{result.outcome}: {result.message}"


@pytest.mark.parametrize("name", [name for name in zoo.NAMES if name not in OFF_THEIR_COSTMAP] if LONG else IN_A_FIELD)
def test_it_drives_through_a_field_of_obstacles_by_its_own_files(name):
    pytest.importorskip("pybullet", reason="pybullet is not there for this interpreter")
    from mbf_relay.lockstep.episode import Episode

    result = Episode(zoo.through_field(name, FIELD), zoo.setup_for(name), seed=1).run()
    assert result.contacts == (name in TOUCHES), f"{result.outcome}: {result.message}"
    assert result.success or name in IT_STANDS + TOUCHES, f"{result.outcome}: {result.message}"
