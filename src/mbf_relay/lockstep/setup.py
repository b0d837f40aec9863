"""The setup of episodes: the nodes' parameters, the source of the pose, and whether there is a map."""

from __future__ import annotations

import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Dict, Iterable, Iterator, List, Mapping, Optional, Sequence, Tuple, Type

import numpy as np

from mbf_relay.costmap.factory import build_costmap, layer_class, layer_groups
from mbf_relay.costmap.parameters import CostmapParameters
from mbf_relay.localization.node_parameters import INITIAL, NODE_ONLY, AmclParameters, require_initial_pose
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.lockstep.fitting import fitted
from mbf_relay.lockstep.settings import Settings, change, flatten, load_own, load_settings, merged, own_part
from mbf_relay.lockstep.tasks import MAP_RESOLUTION, EpisodeTask
from mbf_relay.maps import COARSEST, FINEST
from mbf_relay.navigation.examination import CLAMPED, DOUBTFUL, IGNORED, STOOD_IN, examine_server
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.plugin_lists import PLUGIN_LISTS
from mbf_relay.navigation.registry import entries_of
from mbf_relay.navigation.worker import InlineWorker
from mbf_relay.parameters import ParameterSet
from mbf_relay.plugins import find_class
from mbf_relay.simulation.faults import Faults
from mbf_relay.simulation.node_parameters import SimulatorParameters
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.robot import RobotModel
from mbf_relay.simulation.robot_file import load_robot
from mbf_relay.simulation.world_map import SCAN_HEIGHT

AMCL, ODOMETRY, TRUTH = LOCALIZATIONS = ("amcl", "odometry", "truth")
"""Sources of the robot's pose: amcl's filter, odometry from the true start on, or the simulator."""
KNOWN, NONE = MAPS = ("known", "none")
"""Whether the robot has a map of the world."""

SERVER = "move_base_flex"
"""Name of the server's parameters among the settings."""
MARGIN = 3.0
"""Least metres around start and goals that the global costmap covers where there is no map."""
FARTHEST = 30.0
"""Most metres around start and goals that it covers, however large the world is."""

LAID = ("static_map", "rolling_window", "track_unknown_space", "origin_x", "origin_y", "width", "height")
"""Parameters of the global costmap that are set by `without_map` where there is no map, whatever the user's are."""
UNHEARD = ("imu_rate", "gyro_noise", "accelerometer_noise", "joint_state_rate")
"""Parameters of simulated sensors that are not used in lockstep."""
OF_THE_NODE = {*AmclParameters.names(), *NODE_ONLY} - {*LocalizerParameters.names(), "odom_frame_id", "global_frame_id"}
"""Parameters of the amcl node that are not used in lockstep: on topics, publishing and start-up."""
TOLD = (IGNORED, CLAMPED, STOOD_IN, DOUBTFUL)
"""Kinds of findings about the server's parameters that a user's own ones are noted for."""
RESOLUTION = "--map-resolution"
"""Name under which `_idle` yields the map resolution: it is an option, not a parameter of a node."""


@dataclass(frozen=True)
class Setup:
    """What all episodes of a batch have in common.

    Attributes:
        settings: Parameters by node, as in the nodes' files.
        localization: One of LOCALIZATIONS.
        map: One of MAPS.
        controller, planner: Names in the server's lists; the first of each list where empty.
        map_resolution: Metres per cell of maps drawn from a world.
        robot: The robot; the one the simulator's parameters name where None.
        after_contact: Whether a drive goes on after a contact, which fails it all the same.
        notes: For people: the user's parameters that have no effect or were changed, and warnings of the robot's file.
    """

    settings: Settings
    localization: str = AMCL
    map: str = KNOWN
    controller: str = ""
    planner: str = ""
    map_resolution: float = MAP_RESOLUTION
    robot: Optional[RobotModel] = None
    after_contact: bool = False
    notes: Tuple[str, ...] = ()


def make_setup(
    folder: Path, localization: Optional[str] = None, prior_map: Optional[str] = None, controller: str = "",
    planner: str = "", changes: Iterable[str] = (), has_map: bool = True, config: Optional[Path] = None,
    map_resolution: float = MAP_RESOLUTION, robot: str = "", after_contact: bool = False,
    tasks: Sequence[EpisodeTask] = (),
) -> Setup:
    """Return the setup a user asks for.

    Args:
        folder: Folder of the nodes' YAML files.
        localization: One of LOCALIZATIONS; where None, AMCL with a map, else ODOMETRY.
        prior_map: One of MAPS; where None, by `has_map`.
        controller, planner: Names in the server's lists; the first of each list where empty.
        changes: Changes "a.b=c" to parameters.
        has_map: Whether robots usually have a map of these worlds.
        config: The user's own parameters, a file or folder, which override those in `folder`.
        map_resolution: Metres per cell of maps drawn from a world.
        robot: Robot instead of the one in the simulator's file, with all parameters fitted to it; see `load_robot`.
        after_contact: Whether drives go on after a contact.
        tasks: The tasks to drive, for notes on parameters that they override.

    Raises:
        ValueError: A file, a name or a change is wrong, or the choices contradict each other.
    """
    prior_map = prior_map or (KNOWN if has_map else NONE)
    localization = localization or (AMCL if prior_map == KNOWN else ODOMETRY)
    if prior_map == NONE and localization == AMCL:
        raise ValueError("amcl needs a map: choose --map known, or --localization odometry or truth")
    if not FINEST <= map_resolution <= COARSEST:
        raise ValueError(f"--map-resolution is {map_resolution:g} m; it must be {FINEST:g} to {COARSEST:g} m")
    settings = load_settings(folder)
    if robot:
        settings = fitted(settings, load_robot(robot))
        settings["simulator"]["robot"] = robot
    packages = settings
    if config is not None:
        settings = merged(settings, load_own(config))
        _check_values(settings)  # before `known_names` looks up their plugins
    files = settings
    for text in changes:  # one by one: one may add a plugin, whose parameters the next one changes
        settings = change(settings, [text], known_names(settings))
    _check_values(settings)
    for kind, name in (("controllers", controller), ("planners", planner)):
        _check_listed(settings[SERVER].get(kind, []), kind, name)
    model = load_robot(named_robot(settings))  # here, as a worker on another machine may not have the file
    notes = _notes_on(settings, packages) if settings != packages else []
    notes += [f"robot '{model.name}': {warning}" for warning in model.warnings]
    setup = Setup(settings, localization, prior_map, controller, planner, map_resolution, model, after_contact)
    changed = [*flatten(own_part(settings, files)), *([RESOLUTION] if map_resolution != MAP_RESOLUTION else [])]
    return replace(setup, notes=(*notes, *_notes_on_idle(changed, setup, tasks)))


def _notes_on_idle(changed: Iterable[str], setup: Setup, tasks: Sequence[EpisodeTask]) -> List[str]:
    """Return a note for each changed parameter that has no effect in these drives, with the reason.

    Args:
        changed: Full names of parameters, and RESOLUTION.
        setup: The setup.
        tasks: The tasks to drive, where they are known.
    """
    reasons = dict(_idle(setup, tasks))
    return [f"{name}: has no effect in these drives: {why}" for name in changed for idle, why in reasons.items()
            if f"{name}.".startswith(f"{idle}.")]


def _idle(setup: Setup, tasks: Sequence[EpisodeTask]) -> Iterator[Tuple[str, str]]:
    """Yield each parameter, or group of them, that has no effect in these drives, with the reason."""
    for name in UNHEARD:
        yield f"simulator.{name}", "no part of them listens to that sensor"
    if setup.localization != AMCL:
        yield "amcl", f"the pose comes from {setup.localization}, not from amcl"
    else:
        for name in OF_THE_NODE:
            yield f"amcl.{name}", "it is of amcl as a node, and its filter alone drives"
        if tasks and all(task.initial_pose is not None for task in tasks):
            for name in INITIAL:
                if "pose" in name:
                    yield f"amcl.{name}", "the worlds say where the robot starts"
    if setup.map == NONE:
        yield RESOLUTION, "the robot has no map"
        for name in LAID:
            yield f"{SERVER}.global_costmap.{name}", "without a map the global costmap is laid round start and goals"
    elif tasks and all(task.given_map is not None for task in tasks):
        yield RESOLUTION, "the worlds have maps of their own"
    for kind, asked in (("controllers", setup.controller), ("planners", setup.planner)):
        names = [entry["name"] for entry in setup.settings[SERVER].get(kind, [])]
        for name in names:
            chosen = asked or names[0]
            if name != chosen:
                yield f"{SERVER}.{name}", f"{chosen} takes its place"


def _notes_on(settings: Settings, packages: Settings) -> List[str]:
    """Return notes on parameters that are unknown, unused, clamped, doubtful, or taken by a stand-in for a plugin.

    Args:
        settings: The settings with the user's own parameters.
        packages: Those without; there are no notes on what is in them.
    """
    now, before = examine_server(settings[SERVER]).of(*TOLD), []
    if now:  # seldom; saves time in tune.py, which calls this for each trial
        before = examine_server(packages[SERVER]).of(*TOLD)
    theirs = set(flatten(packages)) | {f"{SERVER}.{group}" for group in packages[SERVER]}
    notes = []
    for finding in now:
        name = f"{SERVER}.{finding.name.replace('/', '.')}"
        if finding not in before and not (finding.kind == IGNORED and name in theirs):
            notes.append(f"{name}: {finding.text}")
    simulator, amcl = settings["simulator"], settings["amcl"]
    for name, kind, values, known in (
        ("simulator", SimulatorParameters, simulator, {*packages["simulator"], "faults"}),
        ("simulator.faults", Faults, simulator.get("faults", {}), set()),
        ("amcl", AmclParameters, amcl, {*packages["amcl"], *INITIAL, *NODE_ONLY}),
    ):
        unknown = [own for own in kind.unknown_names(values) if own not in known]
        notes += [f"{name}.{own}: is not known here{kind.hint(own)}" for own in unknown]
    return notes + _note_on_fit(settings, packages)


def _note_on_fit(settings: Settings, packages: Settings) -> List[str]:
    """Return a note where the simulator's robot was changed but the costmaps keep another robot's footprint."""
    own, theirs = named_robot(settings), named_robot(packages)
    (before, footprint) = (values[SERVER]["local_costmap"].get("footprint") for values in (packages, settings))
    if own == theirs or footprint != before:  # nearly always; saves loading robots
        return []
    if np.array_equal(load_robot(own).footprint, load_robot(theirs).footprint):
        return []
    return [f"simulator.robot: {own} drives with the footprint of {theirs}; --robot {own} fits all parameters to it"]


def named_robot(settings: Settings) -> str:
    """Return the name or file of the robot that the simulator's parameters name."""
    return str(settings["simulator"].get("robot", SimulationParameters.robot))


def faults_in(settings: Settings) -> Faults:
    """Return the faults that the simulator's parameters ask for; raise ValueError where they are invalid."""
    group = settings["simulator"].get("faults", {})
    if not isinstance(group, Mapping):
        raise ValueError(f"simulator.faults is {group!r}; it must be a group, as {{slip: 0.3}}")
    return Faults.from_mapping(group)


def _check_values(settings: Settings) -> None:
    """Raise ValueError where a parameter has a wrong value, before any world is built."""
    SimulationParameters.from_mapping(settings["simulator"])
    faults_in(settings)
    AmclParameters.from_mapping(settings["amcl"])
    require_initial_pose(settings["amcl"])
    server = settings[SERVER]
    for name in ("global_costmap", "local_costmap"):
        for layer, reason in build_costmap(name, server.get(name, {}), server).failed.items():
            raise ValueError(f"{name}: layer '{layer}': {reason}")
    NavigatorParameters.from_mapping(server)
    for listed in PLUGIN_LISTS:
        for reason in listed.registry(server, InlineWorker()).failed.values():
            raise ValueError(reason)


def known_types(settings: Settings) -> Dict[str, Any]:
    """Return the type of each parameter by its full name: as declared by its part, else that of its value in the files.
    """
    server = settings[SERVER]
    found: Dict[str, Any] = {name: type(value) for name, value in flatten(settings).items()}

    def declare(prefix: str, parameters: Type[ParameterSet]) -> None:
        found.update({f"{prefix}.{name}": declared for name, declared in parameters.types().items()})

    declare("simulator", SimulationParameters)
    declare("simulator.faults", Faults)
    declare("amcl", AmclParameters)
    found.update({f"amcl.{name}": float for name in INITIAL})
    declare(SERVER, NavigatorParameters)
    for listed in PLUGIN_LISTS:
        for name, (type_name, _) in entries_of(listed.kind, server.get(listed.kind, []), listed.costmap).items():
            declare(f"{SERVER}.{name}", find_class(type_name, listed.base, listed.known).Parameters)
    for costmap in ("global_costmap", "local_costmap"):
        group = server.get(costmap, {})
        declare(f"{SERVER}.{costmap}", CostmapParameters)
        for layer, type_name, values in layer_groups(group):
            prefix = f"{SERVER}.{costmap}" + (f".{layer}" if "plugins" in group else "")
            declare(prefix, layer_class(type_name, values).Parameters)
    return found


def known_names(settings: Settings) -> List[str]:
    """Return the full names of all parameters, those in the files and those that only the parts declare."""
    return sorted(known_types(settings))


def without_map(server: Dict[str, Any], task: EpisodeTask) -> Dict[str, Any]:
    """Return the server's parameters for a robot without a map: its global costmap has only the obstacles it has seen.

    The costmap is fixed and covers start, goals and all bodies around them, as the path may need a detour. Unknown
    space counts as free; else nothing could be planned. Its resolution, where none is set, is at least the local
    costmap's.
    """
    changed = copy.deepcopy(server)
    group = changed["global_costmap"]
    seen = changed.get("local_costmap", {}).get("resolution", CostmapParameters.resolution)
    group.setdefault("resolution", min(seen, CostmapParameters.resolution))
    low, high = _extent(task)
    group.update(zip(LAID, (False, False, False, *low, high[0] - low[0], high[1] - low[1])))
    if "plugins" in group:
        seeing = [name for name, type_name, values in layer_groups(group)
                  if not layer_class(type_name, values).maps_floor]
        group["plugins"] = [entry for entry in group["plugins"] if entry["name"] in seeing]
    return changed


def _extent(task: EpisodeTask) -> Tuple[List[float], List[float]]:
    """Return the lower left and upper right corner (x, y in metres) of the global costmap without a map."""
    ends = np.array([pose[:2] for pose in (task.world.start, *task.goals)])
    solids = np.vstack((task.world.outline(SCAN_HEIGHT).reshape(-1, 2), ends))
    lowest, highest = ends.min(axis=0), ends.max(axis=0)
    low = np.maximum(np.minimum(lowest - MARGIN, solids.min(axis=0)), lowest - FARTHEST)
    high = np.minimum(np.maximum(highest + MARGIN, solids.max(axis=0)), highest + FARTHEST)
    return low.tolist(), high.tolist()


def _check_listed(entries: List[Any], kind: str, name: str) -> None:
    names = [entry["name"] for entry in entries]
    if name and name not in names:
        raise ValueError(f"there is no '{name}' among the {kind} of {SERVER}.yaml; there are {', '.join(names)}")
