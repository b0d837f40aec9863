"""Whatever a file says of any one parameter, the node starts, or ends with one line that names it."""

import functools
import json
import math
import random
from pathlib import Path
from typing import Any, Optional

import yaml
from node_starts import MAP, how_they_start
from tally import how_many, trial

from mbf_relay import plugins
from mbf_relay.control.velocity_guard_parameters import VelocityGuardParameters
from mbf_relay.costmap import LAYERS, factory
from mbf_relay.costmap.layer import Layer
from mbf_relay.costmap.observation_source import SourceParameters
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.localization.cloud_scan import CloudParameters
from mbf_relay.localization.fake_localization import FakeLocalizationParameters
from mbf_relay.localization.node_parameters import INITIAL, AmclParameters
from mbf_relay.navigation.move_base_parameters import MoveBaseParameters
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.plugin_lists import PLUGIN_LISTS
from mbf_relay.navigation.waypoints import WaypointFollowerParameters
from mbf_relay.ros.relay.relay import RelayParameters
from mbf_relay.simulation.faults import Faults
from mbf_relay.simulation.node_parameters import SimulatorParameters
from mbf_relay.view.parameters import WebViewParameters

ROOT = Path(__file__).resolve().parents[3]
ALL = 10000
"""More starts than there are parameters times values."""
NEVER_RIGHT = {"group": {"a": 1}, "list": [], "lists": [1, "x", [math.nan]]}
"""For a number, a text or a switch."""
VALUES = {
    **NEVER_RIGHT, "NaN": math.nan, "inf": math.inf, "-inf": -math.inf, "negative": -1, "huge": 1e300,
    "far below": -1e300, "largest": 2 ** 31 - 1, "tiny": 1e-300, "none": 0, "word": "rubbish", "nothing": "",
    "true": True, "points": [[0, 0], [1, 0]],
}


@functools.lru_cache
def file_of(node):
    """Return what a node runs with in the demo."""
    path = ROOT / "config" / f"{node}.yaml"
    return yaml.safe_load(path.read_text()) if path.exists() else {"web_view": {"port": 0}}.get(node, {})


def declared():
    """Yield (node, group, name, type) for each declared parameter of each node."""
    server = file_of("move_base_flex")
    sets = [("move_base_flex", "", NavigatorParameters.types())]
    for side in ("global_costmap", "local_costmap"):
        names = {"observation_sources": str, "map_type": str}
        for _name, type_name, _group in factory.layer_groups(server[side]):
            names.update(plugins.find_class(type_name, Layer, LAYERS).Parameters.types())
        sets += [("move_base_flex", side, {**names, **CostmapParameters.types()})]
        sets += [("move_base_flex", f"{side}/scan", SourceParameters.types())]
    for listed in PLUGIN_LISTS:
        sets.append(("move_base_flex", "", {listed.kind: list}))
        for entry in server[listed.kind]:
            kind = plugins.find_class(entry["type"], listed.base, listed.known)
            sets.append(("move_base_flex", entry["name"], kind.Parameters.types()))
    relay = {**RelayParameters.types(), **MoveBaseParameters.types()}
    sets += [("move_base_relay", "", relay), ("move_base", "", relay)]
    own = {**dict.fromkeys(INITIAL, Any), "seed": int, "start_anywhere": bool, "saved_odom": Any}
    sets += [("amcl", "", {**AmclParameters.types(), **own}), ("amcl", "cloud", CloudParameters.types())]
    sets += [("map_server", "", {"frame_id": Any, "map_folder": Any})]
    sets += [("simulator", "", SimulatorParameters.types()), ("simulator", "faults", Faults.types())]
    sets += [("velocity_guard", "", VelocityGuardParameters.types()), ("web_view", "", WebViewParameters.types())]
    sets += [("waypoint_follower", "", WaypointFollowerParameters.types())]
    sets += [("fake_localization", "", FakeLocalizationParameters.types())]
    for node, group, types in sets:
        for name, hint in types.items():
            yield node, group, name, hint


def changed(node, group, name, value):
    """Return a node's file with one value changed."""
    values = json.loads(json.dumps(file_of(node)))
    here = values
    for part in filter(None, group.split("/")):
        here[part] = dict(here[part]) if isinstance(here.get(part), dict) else {}
        here = here[part]
    here[name] = value
    return values


def trouble(name, hint, what, came_up, status, said):
    """Return what is wrong with how a node started; empty where nothing is."""
    lines = [line for line in said.splitlines() if any(level in line for level in ("[WARN]", "[ERROR]", "[FATAL]"))]
    fatal = [line for line in lines if "[FATAL]" in line]
    if "Traceback" in said:
        return "a traceback"
    if status is None:
        return "it hangs"
    if came_up:
        wrong = hint in (float, int, bool, Optional[float], Optional[int]) and what in NEVER_RIGHT
        sideways = name in ("max_vel_y", "min_vel_y")  # is not looked at where the robot cannot go there
        unsaid = wrong and not sideways and not any(name in line for line in lines)
        return "nothing is said of it" if unsaid else "" if status == 0 else f"it ended with status {status}"
    return "" if status == 1 and len(fatal) == 1 and name in fatal[0] else f"it ended with status {status}"


def test_a_node_given_any_value_of_any_parameter_starts_or_says_in_a_line_what_is_wrong(tmp_path):
    cases = [(*parameter, what) for parameter in declared() for what in VALUES]
    random.Random(5).shuffle(cases)
    cases = cases[:how_many(24, ALL)]
    arguments = {"map_server": [MAP, "static_map:=another_map"]}
    work = [
        (node, changed(node, group, name, VALUES[what]), arguments.get(node, []))
        for node, group, name, _hint, what in cases
    ]
    found = []
    misplaced = {"footprint_padding": 0.01, "clearing_radius": 0.59}  # the second is move_base's own
    *starts, (_, _, told) = how_they_start([*work, ("move_base", misplaced, [])], tmp_path)
    assert told.count("not known here") == told.count("footprint_padding is not known here") == 1, told
    for (node, group, name, hint, what), (came_up, status, said) in zip(cases, starts):
        wrong = trouble(name, hint, what, came_up, status, said)
        try:
            with trial("starts of a node with one parameter of any kind"):
                assert not wrong, f"{node} {group}/{name} = {VALUES[what]}: {wrong}\n{said[-9000:]}"
        except AssertionError as error:
            found.append(str(error))
    assert not found, f"{len(found)} of {len(cases)}:\n" + "\n".join(found)
