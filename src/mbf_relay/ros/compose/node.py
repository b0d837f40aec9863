"""The compose executable: runs several nodes as forked processes that share the memory of imported modules."""

from __future__ import annotations

import functools
import os
import sys
from typing import Any, Callable, Dict, List, NamedTuple, Sequence, Tuple

from mbf_relay.importing import import_or_exit
from mbf_relay.ros.common.ending import open_standard_streams
from mbf_relay.ros.compose.family import Family  # other modules are imported only in child processes

USAGE = """usage: compose [--no-respawn] -- NODE [ARGUMENT...] [-- NODE [ARGUMENT...]]... [-- [REMAPPING...]]

Run several of the package's nodes as rosrun would run each of them, but as children of one process that has imported
what they need. A node that ends is started again. Remappings after the last -- apply to all nodes.

  compose -- map_server map.yaml -- amcl scan:=laser -- move_base_flex -- move_base_relay --"""
OPTION = "--no-respawn"
WHEN_NEEDED = (
    "mbf_relay.ros.common.reconfigure",  # quietens dynamic_reconfigure
    "mbf_relay.ros.common.logs", "mbf_relay.ros.common.master_watch", "mbf_relay.ros.common.own_address",
    *(f"mbf_relay.ros.common.rospy_patches.{name}"
      for name in ("accepting", "connecting", "receiving", "sending", "starting")),
    "configparser", "dynamic_reconfigure.server", "encodings.idna", "unicodedata",
)
"""Modules that nodes import only while they run, to be imported before the fork too."""


class Member(NamedTuple):
    """A node: its default name, its main function by full dotted name, and that function's keyword arguments."""

    name: str
    place: str
    arguments: Dict[str, Any]


MEMBERS: Dict[str, Member] = {
    "map_server": Member("map_server", "mbf_relay.ros.map_server.node.main", {}),
    "amcl": Member("amcl", "mbf_relay.ros.amcl.node.main", {}),
    "move_base_flex": Member("move_base_flex", "mbf_relay.ros.server.node.main", {}),
    "move_base_relay": Member("move_base", "mbf_relay.ros.relay.node.serve", {"action": True, "topic": True}),
    "mb_relay_server.py": Member("move_base", "mbf_relay.ros.relay.node.serve", {"action": True, "topic": False}),
    "mb_relay_subscriber.py": Member("move_base", "mbf_relay.ros.relay.node.serve", {"action": False, "topic": True}),
}
"""Nodes that can be run, by the names of their executables."""


def main() -> int:
    """Run the nodes given on the command line; return the exit status."""
    open_standard_streams()
    if {"-h", "--help"} & set(sys.argv[1:]):
        print(USAGE)
        return 0
    try:
        respawns, lines = read_arguments(sys.argv[1:])
    except ValueError as error:
        print(f"compose: {error}", file=sys.stderr)
        return 1
    return Family(preload, {line[0]: functools.partial(live, line) for line in lines}, respawns).run()


def read_arguments(arguments: Sequence[str]) -> Tuple[bool, List[List[str]]]:
    """Return whether nodes that end are started again, and the command line of each node.

    Raises:
        ValueError: There is an unknown option or node, a node twice, or none.
    """
    groups: List[List[str]] = [[]]
    for argument in arguments:
        if argument == "--":
            groups.append([])
        else:
            groups[-1].append(argument)
    options, *lines = groups
    unknown = [option for option in options if option != OPTION]
    if unknown:
        raise ValueError(f"{unknown[0]} is no option; {USAGE.splitlines()[0]}")
    for_all: List[str] = []
    if lines and all(":=" in argument for argument in lines[-1]):
        # those two of roslaunch are for the parent process
        for_all = [argument for argument in lines.pop() if not argument.startswith(("__name:=", "__log:="))]
    if not lines:
        raise ValueError(f"no node is named; {USAGE.splitlines()[0]}")
    names = [line[0] if line else "" for line in lines]
    for name in names:
        if name not in MEMBERS:
            raise ValueError(f"'{name}' cannot be a member; there are {', '.join(MEMBERS)}")
        if names.count(name) > 1:
            raise ValueError(f"{name} is named twice; each node can be there once")
    return OPTION not in options, [line + for_all for line in lines]


def preload(names: Sequence[str]) -> None:
    """Import the modules of the given nodes, before they are forked, and exempt them from garbage collection.

    Plugins named in a node's parameters are imported by that node alone.

    Args:
        names: Names of the nodes' executables.
    """
    from mbf_relay.ros.common.node import ALGEBRA_THREADS, spare_what_stays
    from mbf_relay.ros.common.rospy_patches.lazy_modules import import_lazily

    os.environ.setdefault(ALGEBRA_THREADS, "1")  # before NumPy is imported
    import_lazily()
    for name in (*WHEN_NEEDED, *(MEMBERS[name].place.rpartition(".")[0] for name in names)):
        import_or_exit(name)
    spare_what_stays()  # a collection writes to each object, after which its memory page is no longer shared


def live(line: Sequence[str]) -> None:
    """Run the node of a command line in this process; does not return."""
    import rosgraph
    import rospy

    from mbf_relay.ros.common.node import run_node

    sys.argv = list(line)
    remappings: Dict[str, str] = rospy.names.get_mappings()  # rospy has read the parent's command line
    remappings.clear()
    remappings.update(rosgraph.names.load_mappings(sys.argv))
    member = MEMBERS[line[0]]
    run: Callable[..., None] = run_node
    run(member.name, member.place, **member.arguments)
