"""Nodes as one family of processes: what they have in common is imported, and lies in memory, once."""

from __future__ import annotations

import functools
import os
import sys
from typing import Any, Callable, Dict, List, NamedTuple, Sequence, Tuple

from mbf_relay.importing import import_or_exit
from mbf_relay.ros.common.ending import open_standard_streams
from mbf_relay.ros.compose.family import Family  # what else nodes need is imported in children alone

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
"""Modules that nodes import once they run."""


class Member(NamedTuple):
    """A node as its executable runs it: its name, its main function and what that takes."""

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
"""By executable."""


def main() -> int:
    """Run the family the command line names and return its exit status."""
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
    """Return whether nodes are started again, and the command line of each.

    Raises:
        ValueError: They are not understood.
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
        # roslaunch names the family and its log
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
    """Import what nodes will import, in a process without threads, and leave it to no child to collect.

    What its parameters name a node imports by itself: no other one uses it.

    Args:
        names: Of their executables.
    """
    from mbf_relay.ros.common.node import ALGEBRA_THREADS, spare_what_stays
    from mbf_relay.ros.common.rospy_patches.lazy_modules import spare_what_nobody_uses

    os.environ.setdefault(ALGEBRA_THREADS, "1")  # before NumPy is imported
    spare_what_nobody_uses()
    for name in (*WHEN_NEEDED, *(MEMBERS[name].place.rpartition(".")[0] for name in names)):
        import_or_exit(name)
    spare_what_stays()  # a collection writes to all it looks at, and a page that is written to is shared no more


def live(line: Sequence[str]) -> None:
    """Be a node, by its command line; does not return."""
    import rosgraph
    import rospy

    from mbf_relay.ros.common.node import run_node

    sys.argv = list(line)
    remappings: Dict[str, str] = rospy.names.get_mappings()  # rospy has read the parent's
    remappings.clear()
    remappings.update(rosgraph.names.load_mappings(sys.argv))
    member = MEMBERS[line[0]]
    run: Callable[..., None] = run_node
    run(member.name, member.place, **member.arguments)
