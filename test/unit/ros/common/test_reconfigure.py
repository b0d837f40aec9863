"""What rqt_reconfigure shows is what it shows of upstream's nodes: names, types, defaults and the ends of sliders."""

import sys
import types
from pathlib import Path
from types import SimpleNamespace

import pytest

from mbf_relay import files
from mbf_relay.localization.node_parameters import AmclParameters

CONFIG = Path(__file__).resolve().parents[4] / "config"
UPSTREAM = files.parse_yaml((Path(__file__).parent / "upstream_cfg.yaml").read_text(encoding="utf-8"))
EXACT = {("Costmap", "height"), ("Costmap", "width")}
"""Whole metres upstream, which rounds what a file says; with their fractions here."""
NO_ZERO = {
    ("AMCL", "min_particles"): 1, ("AMCL", "max_particles"): 1, ("AMCL", "resample_interval"): 1,
    ("AMCL", "laser_max_beams"): 2, ("MoveBaseFlex", "controller_frequency"): 0.1,
}
"""Where a slider begins that upstream lets go down to 0, with which nothing works there either."""
BOTH_WAYS = {("VoxelLayer", "combination_method")}
"""A slider to 2 upstream, where 99 is one of the choices."""


@pytest.fixture
def offered(monkeypatch):
    """Return what a .cfg file of ours offers: type, default, least and greatest value by name."""

    class Generator:
        found = {}

        def const(self, name, kind, value, description):
            return value

        def enum(self, constants, description):
            return constants

        def add(self, name, kind, level, description, default=None, min=None, max=None, edit_method=""):
            self.found[name] = (kind, default, min, max)

        def generate(self, *names):
            return 0

    module = types.ModuleType("dynamic_reconfigure.parameter_generator_catkin")
    module.ParameterGenerator = Generator
    for kind in ("bool", "int", "double", "str"):
        setattr(module, f"{kind}_t", kind)
    monkeypatch.setitem(sys.modules, "dynamic_reconfigure", types.ModuleType("dynamic_reconfigure"))
    monkeypatch.setitem(sys.modules, module.__name__, module)

    def read(name):
        path = CONFIG / f"{name}.cfg"
        Generator.found = {}
        with pytest.raises(SystemExit):
            exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), {"__file__": str(path)})
        return Generator.found

    return read


@pytest.mark.parametrize("name", sorted(UPSTREAM))
def test_names_types_and_defaults_are_upstream_s(offered, name):
    found = offered(name)
    for parameter, (kind, default, _low, _high) in UPSTREAM[name].items():
        assert found[parameter][:2] == ("double" if (name, parameter) in EXACT else kind, default), parameter


@pytest.mark.parametrize("name", sorted(UPSTREAM))
def test_sliders_begin_and_end_where_upstream_s_do(offered, name):
    found = offered(name)
    for parameter, (_kind, _default, low, high) in UPSTREAM[name].items():
        if (name, parameter) in BOTH_WAYS:
            continue
        if low is not None:
            assert found[parameter][2] == NO_ZERO.get((name, parameter), low), parameter
        if high is not None:
            assert found[parameter][3] == pytest.approx(high), parameter


@pytest.mark.parametrize("path", sorted(CONFIG.glob("*.cfg")), ids=lambda path: path.stem)
def test_a_slider_of_ours_is_of_a_length_a_hand_can_use(offered, path):
    for parameter, (kind, default, low, high) in offered(path.stem).items():
        if kind == "double" and low is not None and high is not None:
            assert high - low <= 2000.0 * max(1.0, abs(default)), parameter


def served(monkeypatch, parameters, low, high):
    """Return how to change laser_max_beams as a client does, past a server that offers low to high; and what came."""
    from mbf_relay.ros.common import reconfigure

    kept, taken = {}, []

    class Server:
        def __init__(self, _config_type, take, namespace):
            kept["take"] = take
            take({"laser_max_beams": 30, "laser_z_hit": 0.9}, 0)

    monkeypatch.setitem(sys.modules, "rospy", SimpleNamespace(logerr=lambda *words: taken.append(words)))
    monkeypatch.setitem(sys.modules, "dynamic_reconfigure", types.ModuleType("dynamic_reconfigure"))
    monkeypatch.setitem(sys.modules, "dynamic_reconfigure.server", SimpleNamespace(Server=Server))
    config_type = SimpleNamespace(
        min={"laser_max_beams": low, "laser_z_hit": 0.0}, max={"laser_max_beams": high, "laser_z_hit": 1.0})
    reconfigure.serve(config_type, parameters, taken.append)
    return kept["take"], taken


def test_a_value_of_a_file_beyond_its_slider_outlives_the_change_of_another(monkeypatch):
    take, taken = served(monkeypatch, AmclParameters(laser_max_beams=360, laser_z_hit=0.9), 2, 250)
    shown = take({"laser_max_beams": 250, "laser_z_hit": 0.5}, 0)  # as dynamic_reconfigure's server hands it over
    assert [(each.laser_max_beams, each.laser_z_hit) for each in taken] == [(360, 0.5)]
    assert shown["laser_max_beams"] == 360
    take({"laser_max_beams": 100, "laser_z_hit": 0.5}, 0)
    assert taken[-1].laser_max_beams == 100
