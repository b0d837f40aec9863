"""Declared parameters: ranges, types, aliases and the words of a refusal."""

import re
from dataclasses import dataclass
from typing import Optional, Tuple

import pytest

from mbf_relay.costmap.costmap_filter import CostmapFilterParameters
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.costmap.static_layer import StaticLayerParameters
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.waypoints import WaypointFollowerParameters
from mbf_relay.parameters import ParameterSet, parameter, without_effect


@dataclass(frozen=True)
class Example(ParameterSet):
    speed: float = parameter(0.22, "top speed", unit="m/s", minimum=0.0, maximum=1.0, aliases=("max_speed",))
    period: float = parameter(0.1, "time between cycles", unit="s", above=0.0)
    samples: int = parameter(20, "how many", minimum=1)
    model: str = parameter("diff", "kind of drive", choices=("diff", "omni"))
    active: bool = parameter(True, "whether it is on")
    outline: Tuple[Tuple[float, float], ...] = parameter(((0.0, 0.0), (1.0, 0.0)), "corner points", unit="m")
    limit: Optional[float] = parameter(None, "none for no limit", unit="m", minimum=0.0)
    least: float = parameter(0.0, "lowest speed", unit="m/s")

    name: str = parameter("robot", "what it is called")
    frame: str = parameter("odom", "in which it drives", is_frame=True)
    weights: Tuple[float, ...] = parameter((1.0,), "of what counts", minimum=0.0)
    wait: float = parameter(1.0, "how long it waits", unit="s", above=0.0)
    reach: float = parameter(float("inf"), "how far it sees", unit="m", minimum=0.0)
    filter: str = without_effect("voxel", "all points are used", choices=("voxel", "none"))
    max_z: float = without_effect(10.0, "there is no frustum", "m")

    ORDERED = (("least", "speed"),)

    def check(self):
        if self.speed * self.period > 0.5:
            raise ValueError("speed times period is above 0.5 m")


def test_numbers_are_taken_as_the_declared_type():
    example = Example(speed=1, samples=3.0, outline=[[0, 0], [1, 2]])
    assert example.speed == 1.0 and isinstance(example.speed, float)
    assert example.samples == 3 and isinstance(example.samples, int)
    assert example.outline == ((0.0, 0.0), (1.0, 2.0))


@pytest.mark.parametrize(
    "values, words",
    [
        ({"speed": -0.1}, ["speed", "-0.1", "at least 0.0 m/s"]),
        ({"speed": 1.5}, ["speed", "1.5", "at most 1.0 m/s"]),
        ({"speed": "fast"}, ["speed", "'fast'", "float"]),
        ({"speed": True}, ["speed", "True", "float"]),
        ({"speed": float("nan")}, ["speed", "NaN"]),
        ({"period": 0}, ["period", "0.0", "above 0.0 s"]),
        ({"samples": 2.5}, ["samples", "2.5", "int"]),
        ({"samples": float("inf")}, ["samples", "inf", "int"]),
        ({"samples": -10 ** 400}, ["samples", "-1000000000000000000", "at least 1"]),
        ({"least": 10 ** 400}, ["least", "1e+18", "within 1e+09 m/s of 0"]),
        ({"model": "car"}, ["model", "'car'", "'diff', 'omni'"]),
        ({"samples": True}, ["samples", "True", "int"]),
        ({"name": 3}, ["name", "3", "str"]),
        ({"name": None}, ["name", "None", "str"]),
        ({"weights": [1.0, 2.0, -0.5]}, ["weights", "-0.5", "at least 0.0"]),
        ({"wait": float("inf")}, ["wait", "inf", "within 1e+09 s of 0"]),
        ({"wait": -1e12}, ["wait", "above 0.0 s"]),
        ({"reach": -1e12}, ["reach", "at least 0.0 m"]),
        ({"active": 1}, ["active", "1", "bool"]),
        ({"outline": "square"}, ["outline", "'square'", "list"]),
        ({"outline": [[0, 0, 0]]}, ["outline", "3 entries", "2"]),
        ({"limit": -1}, ["limit", "-1.0", "at least 0.0 m"]),
        ({"speed": 1.0, "period": 1.0}, ["above 0.5 m"]),
        ({"speed": 0.3, "least": 0.4}, ["least", "0.4", "at most speed", "0.3"]),
    ],
)
def test_a_refusal_names_parameter_value_and_what_is_allowed(values, words):
    with pytest.raises(ValueError) as refusal:
        Example.from_mapping(values)
    for word in words:
        assert word in str(refusal.value)


@pytest.mark.parametrize("values, name, taken, words", [
    ({"speed": -0.3}, "speed", 0.0, ["speed", "-0.3", "at least 0.0 m/s", "0.0 is used"]),
    ({"speed": 55}, "speed", 1.0, ["speed", "55.0", "at most 1.0 m/s", "1.0 is used"]),
    ({"period": 0}, "period", 0.1, ["period", "above 0.0 s", "0.1 is used"]),
    ({"samples": 0}, "samples", 1, ["samples", "at least 1", "1 is used"]),
    ({"samples": 10 ** 400}, "samples", 10 ** 9, ["samples", "within 1e+09 of 0", "1000000000 is used"]),
    ({"speed": 0.3, "least": 0.4}, "least", 0.3, ["least", "0.4", "at most speed", "0.3 is used"]),
    ({"speed": "1e-2"}, "speed", 0.01, ["speed", "'1e-2'", "0.01 is used"]),
    ({"max_speed": 2.0}, "speed", 1.0, ["speed", "2.0", "1.0 is used"]),
    ({"wait": 1e12}, "wait", 1e9, ["wait", "within 1e+09 s of 0", "1000000000.0 is used"]),
    ({"wait": -1e12}, "wait", 1.0, ["wait", "above 0.0 s", "1.0 is used"]),
    ({"samples": "3"}, "samples", 3, ["samples", "'3'", "the number 3 is used"]),
    ({"speed": "0.5 \u3000# 速度"}, "speed", 0.5, ["speed", "# 速度", "the number 0.5 is used"]),
])
def test_a_value_upstream_takes_is_taken_to_the_range_and_told_of(values, name, taken, words):
    example, notes = Example.read(values)
    assert getattr(example, name) == taken
    assert len(notes) == 1
    for word in words:
        assert word in notes[0]


@pytest.mark.parametrize("given, used", [(2.5, 3), (1.4, 1), (0.5, 1)])
def test_a_file_s_number_of_samples_with_a_fraction_is_rounded_as_upstream_rounds_it(given, used):
    example, (note,) = Example.read({"samples": given})
    assert example.samples == used and f"samples is {given}" in note and f": {used} is used" in note


@pytest.mark.parametrize("given, active", [
    (0, False), (1, True), (1.0, True), ("true", True), ("False", False), ("no", False),
    ("true\u3000# 障害物", True),
])
def test_a_switch_in_another_spelling_is_taken_and_told_of(given, active):
    example, notes = Example.read({"active": given})
    assert example.active is active
    assert notes == [f"parameter active is {given!r}: {str(active).lower()} is used"]


@pytest.mark.parametrize("given", [2, 0.5, "", "maybe", [True]])
def test_what_is_no_switch_is_refused(given):
    with pytest.raises(ValueError, match="active is .*bool"):
        Example.read({"active": given})


@pytest.mark.parametrize("given, used", [(-3.0, 20.0), (0.0, 20.0), (0.01, 0.1), (1000.0, 100.0)])
def test_a_robot_is_not_driven_unseen_for_seconds_since_its_file_has_no_rate_of_control(given, used):
    read, notes = NavigatorParameters.read({"controller_frequency": given})
    assert read.controller_frequency == used
    assert any(f": {used} is used" in note for note in notes)


def test_values_in_order_are_read_without_a_word():
    assert Example.read({"speed": 0.3, "least": 0.1, "elsewhere": 3}) == (Example(speed=0.3, least=0.1), [])


@pytest.mark.parametrize("values", [
    {"speed": "fast"}, {"model": "car"}, {"speed": float("nan")}, {"outline": 3}, {"least": 1e12}, {"least": -1e12},
    {"samples": float("inf")}, {"samples": float("nan")}])
def test_what_nobody_can_make_sense_of_is_refused_all_the_same(values):
    with pytest.raises(ValueError, match=next(iter(values))):
        Example.read(values)


@pytest.mark.parametrize("name, value", [
    ("filter", False), ("filter", "fine"), ("max_z", "far"), ("max_z", [7.0])])
def test_a_robot_starts_though_what_has_no_effect_has_no_value_that_makes_sense(name, value):
    """The server refused to start for what it does not use, and what upstream's takes for the default."""
    read, [note] = Example.read({name: value})
    assert read == Example() and f"parameter {name} is {value!r}" in note


def test_an_old_name_is_read_and_reported_and_the_present_one_wins():
    assert Example.from_mapping({"max_speed": 0.5}).speed == 0.5
    assert Example.from_mapping({"max_speed": 0.5, "speed": 0.4}).speed == 0.4
    assert Example.deprecated_names({"max_speed": 0.5}) == {"max_speed": "speed"}


def test_unknown_names_are_told_of_groups_as_well_but_of_those_that_are_read():
    class WithAGroup(Example):
        @classmethod
        def groups(cls, values):
            return ["sensor"]

    values = {"sped": 1, "max_speed": 0.5, "perod": {"a": 1}, "sensor": {"topic": "scan"}}
    assert Example.unknown_names(values) == ["sped", "perod", "sensor"]
    assert WithAGroup.unknown_names(values) == ["sped", "perod"]
    assert Example.hint("sped") == "; did you mean 'speed'?"


def test_a_changed_copy_is_checked_too():
    with pytest.raises(ValueError, match="speed"):
        Example().replace(speed=-1.0)


def test_what_has_no_end_by_default_may_have_none():
    assert Example().reach == float("inf") and Example(reach=1e12).reach == 1e12


def test_a_frame_is_named_as_tf2_does():
    assert Example(frame="/odom").frame == "odom" and Example(name="/odom").name == "/odom"


@pytest.mark.parametrize("changes, least, count", [
    ({"speed": 0.1}, 0.1, 1), ({"speed": 0.2}, 0.2, 0), ({"speed": 0.3}, 0.2, 0),
    ({"speed": 0.3, "least": 0.1}, 0.1, 0)])
def test_who_asks_a_robot_to_drive_slower_is_not_refused_for_its_lowest_speed(changes, least, count):
    changed, notes = Example(speed=0.5, least=0.2).reconfigured(changes)
    assert changed == Example(speed=changes["speed"], least=least) and len(notes) == count
    assert all("least is 0.2; it must be at most speed: 0.1 is used" in note for note in notes)


@pytest.mark.parametrize("changes", [{"speed": 0.1, "least": 0.2}, {"least": 0.6}, {"speed": -0.1}, {"speed": 1.1}])
def test_who_asks_for_speeds_that_contradict_each_other_is_refused(changes):
    with pytest.raises(ValueError, match="least is|speed is"):
        Example(speed=0.5, least=0.2).reconfigured(changes)


@pytest.mark.parametrize("kind, name", [
    (StaticLayerParameters, "map_topic"), (CostmapParameters, "footprint_topic"),
    (CostmapFilterParameters, "filter_mask_topic"), (WaypointFollowerParameters, "addpose_topic"),
])
def test_who_names_no_topic_reads_which_parameter_it_is(kind, name):
    """The server ended with "topic name is not a non-empty string"."""
    for value in ("/robot1/map_2", "~map"):
        assert getattr(kind.read({name: value})[0], name) == value
    for value in ("", "a b", "1st", "caf\u00e9", "map\n"):
        said = re.escape(f"parameter {name} is {value!r}; it must be a topic's name")
        with pytest.raises(ValueError, match=said):
            kind.read({name: value})


def test_a_mask_out_of_a_file_needs_no_topic():
    assert CostmapFilterParameters(filter_mask_topic="", filter_mask_file="zones.yaml").filter_mask_topic == ""
