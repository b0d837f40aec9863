"""Files written for move_base, read as what a Move Base Flex server needs."""

import math
from dataclasses import dataclass

import pytest

from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.navigation.examination import CLAMPED, examine_move_base
from mbf_relay.navigation.move_base_files import default_recoveries, server_config
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class Values(ParameterSet):
    """As MoveBaseParameters, which ros/ declares."""

    base_global_planner: str = parameter("navfn/NavfnROS", "type")
    base_local_planner: str = parameter("base_local_planner/TrajectoryPlannerROS", "type")
    planner_frequency: float = parameter(0.0, "rate")
    controller_frequency: float = parameter(20.0, "rate")
    planner_patience: float = parameter(5.0, "time")
    controller_patience: float = parameter(5.0, "time")
    max_planning_retries: int = parameter(-1, "how often")
    conservative_reset_dist: float = parameter(3.0, "distance")
    recovery_behavior_enabled: bool = parameter(True, "whether")
    clearing_rotation_allowed: bool = parameter(True, "whether")
    shutdown_costmaps: bool = parameter(False, "whether")
    oscillation_timeout: float = parameter(0.0, "time")
    oscillation_distance: float = parameter(0.5, "distance")


def config(**namespace):
    return server_config(namespace, Values.from_mapping(namespace))


def test_a_bare_move_base_has_upstream_s_default_plugins():
    made = config()
    assert made["planners"] == [{"name": "NavfnROS", "type": "navfn/NavfnROS"}]
    assert made["controllers"] == [{"name": "TrajectoryPlannerROS", "type": "base_local_planner/TrajectoryPlannerROS"}]
    assert [entry["name"] for entry in made["recovery_behaviors"]] == [
        "conservative_reset",
        "rotate_recovery",
        "aggressive_reset",
    ]
    assert made["conservative_reset"]["reset_distance"] == 3.0
    assert made["aggressive_reset"]["reset_distance"] == pytest.approx(4 * 0.46)


def test_a_robot_whose_file_gives_no_patience_waits_for_people_as_long_as_with_move_base():
    """It turned and cleared its costmaps after 5 s, before whoever stood there had gone on."""
    assert examine_move_base({}).config["controller_patience"] == 15.0
    assert examine_move_base({"controller_patience": 5.0}).config["controller_patience"] == 5.0


def test_the_default_recoveries_are_four_of_which_two_turn():
    assert default_recoveries(Values()) == (
        "conservative_reset",
        "rotate_recovery",
        "aggressive_reset",
        "rotate_recovery",
    )
    assert default_recoveries(Values(clearing_rotation_allowed=False)) == ("conservative_reset", "aggressive_reset")


@pytest.mark.parametrize("wrong", [{"name": "aggressive_reset2"}, "aggressive_reset2", {
    "name": "clear", "type": "clear_costmap_recovery/ClearCostmapRecovery"}])
def test_a_robot_with_one_recovery_of_no_type_starts_with_the_default_ones_as_under_move_base(wrong):
    """Pepper's file has such an entry, the last of six: its navigation did not start."""
    listed = [{"name": "clear", "type": "clear_costmap_recovery/ClearCostmapRecovery"}, wrong]
    made = config(recovery_behaviors=listed)
    assert made["recovery_behaviors"] == config()["recovery_behaviors"]
    assert made["conservative_reset"] == {"reset_distance": 3.0}
    found = examine_move_base({"recovery_behaviors": listed})
    assert [(finding.kind, finding.name) for finding in found.findings if "recovery_behaviors" in finding.text] == [
        (CLAMPED, "recovery_behaviors")]


def test_a_user_s_recoveries_and_groups_are_his_own():
    listed = [{"name": "back", "type": "back_up"}]
    made = config(recovery_behaviors=listed, back={"distance": 0.2}, TrajectoryPlannerROS={"max_vel_x": 0.3})
    assert made["recovery_behaviors"] == listed and "conservative_reset" not in made
    assert made["back"] == {"distance": 0.2} and made["TrajectoryPlannerROS"] == {"max_vel_x": 0.3}


def test_a_distance_the_file_gives_a_default_recovery_holds():
    assert config(aggressive_reset={"reset_distance": 0.5})["aggressive_reset"]["reset_distance"] == 0.5
    assert config(conservative_reset_dist=1.0)["conservative_reset"]["reset_distance"] == 1.0


def test_a_robot_that_turns_slowly_comes_round():
    """move_base knows no patience with a recovery: at 0.3 rad/s a turn takes 21 s."""
    assert NavigatorParameters.read(config())[0].recovery_patience == 0.0
    assert NavigatorParameters.read(config(recovery_patience=30.0))[0].recovery_patience == 30.0


def test_frames_are_the_global_costmap_s_without_a_slash():
    made = config(global_costmap={"global_frame": "/odom", "robot_base_frame": "/base_footprint"})
    read = NavigatorParameters.from_mapping(made)
    assert (read.global_frame, read.robot_frame) == ("odom", "base_footprint")
    assert CostmapParameters.from_mapping(made["global_costmap"]).global_frame == "odom"


def test_rates_and_patience_go_by_the_server_s_names():
    made = config(max_planning_retries=3, recovery_behavior_enabled=False, planner_frequency=2.0)
    assert (made["planner_max_retries"], made["recovery_enabled"], made["planner_frequency"]) == (3, False, 2.0)
    assert "max_planning_retries" not in made and "base_local_planner" not in made


@pytest.mark.parametrize("kind", ["planner", "controller"])
def test_no_patience_is_one_try_and_not_patience_for_ever(kind):
    """A goal that cannot be reached never ended: 0 is for ever to a Move Base Flex server, and at once to move_base."""
    made = NavigatorParameters.read(config(**{f"{kind}_patience": 0.0}))[0]
    assert getattr(made, f"{kind}_patience") > 0.0 and getattr(made, f"{kind}_max_retries") == 0
    made = NavigatorParameters.read(config(controller_max_retries=3))[0]
    assert (made.controller_max_retries, made.planner_max_retries) == (3, -1)


@pytest.mark.parametrize("radius", [[], "wide", math.nan])
def test_a_radius_that_is_no_number_is_named_and_no_traceback(radius):
    with pytest.raises(ValueError, match="circumscribed_radius"):
        config(local_costmap={"circumscribed_radius": radius})
