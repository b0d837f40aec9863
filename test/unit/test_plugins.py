"""Plugins found by upstream name, by path, or refused with what there is."""

import abc
from dataclasses import dataclass
from pathlib import Path

import pytest

from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.plugins import Plugin, PluginError, create, plugin_name


class Tool(Plugin):
    """A kind of plugin."""


class Hammer(Tool):
    @dataclass(frozen=True)
    class Parameters(ParameterSet):
        weight: float = parameter(1.0, "how heavy", unit="kg", above=0.0)


class Screw(Tool):
    def __init__(self, name, parameters):
        super().__init__(name, parameters)
        Path("/no/such/thread.bin").read_bytes()


class Anvil(Tool):
    def __init__(self, name, parameters):
        super().__init__(name, parameters)
        {}["heat"]


class Orphan(Tool):
    def __init__(self, name, parameters):
        self.weight = 1.0


class Mallet(Hammer):
    stands_in = "the mallet strikes with its weight"


class Handle(Tool, abc.ABC):
    @abc.abstractmethod
    def hold(self):
        """Left to subclasses."""


class Apple(Plugin):
    """Another kind."""


KNOWN = {"tools/Hammer": f"{__name__}.Hammer", "heavy_tools/SledgeHammer": f"{__name__}.Mallet"}


def test_a_known_name_and_a_path_lead_to_the_same_class():
    for type_name in ("tools/Hammer", f"{__name__}.Hammer"):
        plugin = create("mine", type_name, {"weight": 2}, Tool, KNOWN)
        assert isinstance(plugin, Hammer) and plugin.name == "mine" and plugin.parameters.weight == 2.0


def test_the_last_part_of_a_known_name_will_do_as_in_files_of_long_ago():
    assert isinstance(create("mine", "Hammer", {}, Tool, KNOWN), Hammer)


def test_what_could_not_be_taken_as_it_is_stands_in_the_notes():
    plugin = create("mine", "heavy_tools/SledgeHammer", {"weight": 0}, Tool, KNOWN)
    assert plugin.parameters.weight == 1.0
    stand_in, clamped = plugin.notes
    assert "heavy_tools/SledgeHammer is not available here" in stand_in and "strikes with its weight" in stand_in
    for word in ("weight", "0.0", "above 0.0 kg", "1.0 is used"):
        assert word in clamped
    assert create("mine", "tools/Hammer", {"weight": 2.0}, Tool, KNOWN).notes == ()


@pytest.mark.parametrize("type_name", ["their_tools/Hammer", "their_tools::Hammer"])
def test_a_copy_of_a_plugin_in_another_package_is_stood_in_for_by_what_it_was_copied_from(type_name):
    """A robot whose planner was a changed copy of navfn, of that class's name, planned nothing at all."""
    plugin = create("mine", type_name, {"weight": 2.0}, Tool, KNOWN)
    assert isinstance(plugin, Hammer) and plugin.parameters.weight == 2.0
    assert plugin.notes == (f"{type_name} is not available here; tools/Hammer does its job",)


def test_which_of_two_was_copied_is_not_guessed():
    with pytest.raises(PluginError, match="unknown tool type 'their_tools/Hammer'"):
        create("mine", "their_tools/Hammer", {}, Tool, {**KNOWN, "light_tools/Hammer": f"{__name__}.Mallet"})


@pytest.mark.parametrize(
    "type_name, values, words",
    [
        ("tools/Saw", {}, ["tools/Saw", "tools/Hammer"]),
        ("Saw", {}, ["Saw", "tools/Hammer", "package.module.Class"]),
        (f"{__name__}.Saw", {}, ["Saw", "tools/Hammer"]),
        ("no_such_package.Saw", {}, ["no_such_package", "tools/Hammer"]),
        (f"{__name__}.Apple", {}, ["Apple", "must derive from", "Tool"]),
        (f"{__name__}.Screw", {}, ["mine", "Screw", "/no/such/thread.bin"]),
        (f"{__name__}.Handle", {}, ["Handle", "does not define hold"]),
        ("tools/Hammer", {"weight": "much"}, ["mine", "tools/Hammer", "weight", "'much'"]),
        (f"{__name__}.Anvil", {}, ["mine", "Anvil", "KeyError", "heat", "test_plugins.py, line 32"]),
        (f"{__name__}.Orphan", {}, ["mine", "Orphan", "super().__init__(name, parameters)"]),
    ],
)
def test_a_refusal_names_the_plugin_and_what_there_is(type_name, values, words):
    with pytest.raises(PluginError) as refusal:
        create("mine", type_name, values, Tool, KNOWN)
    for word in words:
        assert word in str(refusal.value)


def test_of_a_module_that_python_does_not_find_is_said_where_it_looks():
    with pytest.raises(PluginError, match=r"No module named 'my_tools': is its folder on PYTHONPATH\?\)"):
        create("x", "my_tools.Saw", {}, Tool, KNOWN)
    with pytest.raises(PluginError, match=r"\(No module named 'json\.none'\)"):
        create("x", "json.none.Saw", {}, Tool, KNOWN)


def test_a_file_that_throws_when_it_is_read_is_named_with_the_line(tmp_path, monkeypatch):
    (tmp_path / "thrown_tools.py").write_text("x = 1\nint(speed=3)\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PluginError, match=r"thrown_tools\.Saw.*TypeError: .*\(thrown_tools\.py, line 2\)"):
        create("mine", "thrown_tools.Saw", {}, Tool, KNOWN)


def test_a_file_that_is_no_python_is_named_with_the_line(tmp_path, monkeypatch):
    (tmp_path / "half_written_tools.py").write_text("x = 1\ndef f(:\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(PluginError, match=r"half_written_tools\.Saw.*half_written_tools\.py, line 2"):
        create("mine", "half_written_tools.Saw", {}, Tool, KNOWN)


@pytest.mark.parametrize("type_name, name", [
    ("navfn/NavfnROS", "NavfnROS"), ("SBPLLatticePlanner", "SBPLLatticePlanner"), ("my_planner::Planner", "Planner"),
])
def test_plugins_are_named_as_move_base_names_them(type_name, name):
    assert plugin_name(type_name) == name
