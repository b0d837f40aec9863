"""check_config.py: tell what becomes of the parameters of launch or YAML files, without a robot or a ROS master."""

from __future__ import annotations

import argparse
import sys
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, TextIO, Tuple

from mbf_relay.localization.node_parameters import INITIAL, NODE_ONLY, AmclParameters
from mbf_relay.navigation import examination as exam
from mbf_relay.navigation.examination import Examination, Finding
from mbf_relay.ros.common.logs import plain
from mbf_relay.ros.common.tf_prefix import ignored_prefix
from mbf_relay.ros.tools.launch_arguments import check_argument
from mbf_relay.ros.tools.parameter_source import (
    TYPES,
    Launch,
    LaunchedNode,
    ParameterSource,
    read_launch,
    read_yaml,
)


def _examine_amcl(values: Mapping[str, Any]) -> Examination:
    return exam.examine_set(AmclParameters, values, (*INITIAL, *NODE_ONLY))


EXAMINERS: Dict[str, Callable[[Mapping[str, Any]], Examination]] = {
    "move_base": exam.examine_move_base, "move_base_flex": exam.examine_server, "amcl": _examine_amcl,
}
"""Function that examines the parameters, by type of node."""
PREFIX = "tf_prefix"
TROUBLE = (exam.REFUSED, exam.DOUBTFUL)
"""Kinds of findings for which the exit status is 1; with --strict, all kinds but USED."""


def main(arguments: Optional[Sequence[str]] = None, out: TextIO = sys.stdout) -> int:
    """Run the command; return 0, 1 where something is refused or doubtful, or 2 where nothing could be read."""
    options = _parse(sys.argv[1:] if arguments is None else arguments)
    try:
        nodes, not_read = _read(options)
    except (ValueError, OSError) as error:
        print(plain(f"check_config.py: {error}"), file=sys.stderr)
        return 2
    for text in not_read:
        print(plain(f"not read: {text}"), file=out)
    if not nodes:
        print(f"check_config.py: no node of type {', '.join(TYPES)} is launched there", file=sys.stderr)
        return 2
    worst = 1 if not_read and options.strict else 0
    for node in nodes:
        found = examine(node)
        tell(node, found, out, options.quiet)
        bad = [f for f in found.findings if f.kind in TROUBLE or (options.strict and f.kind != exam.USED)]
        worst = max(worst, 1 if bad else 0)
    return worst


def examine(node: LaunchedNode) -> Examination:
    """Return the examination of a node's parameters, with the doubts about its files, such as keys given twice."""
    found = EXAMINERS[node.type](node.source.values)
    found.findings[:0] = [Finding(exam.DOUBTFUL, name, text) for name, text in node.source.trouble]
    frame = str(found.config.get("base_frame_id" if node.type == "amcl" else "robot_frame", "base_link"))
    text = ignored_prefix(*_prefix_over(node), frame.strip("/"))
    if text:
        found.add(exam.DOUBTFUL, PREFIX, f"parameter {text}")
    return found


def _prefix_over(node: LaunchedNode) -> Tuple[str, Any]:
    """Return full name and value of the tf_prefix that a node finds in its namespace or the nearest above it.

    Its place is noted for `tell`; both are empty where there is none.
    """
    groups = node.name.split("/")
    for depth in range(len(groups), -1, -1):
        above = "/".join(groups[:depth])
        here = node.graph.below(above) if above else node.graph
        if PREFIX in here.values:
            node.source.places[PREFIX] = here.place(PREFIX)
            return f"/{above}/{PREFIX}".replace("//", "/"), here.values[PREFIX]
    return "", ""


def tell(node: LaunchedNode, found: Examination, out: TextIO, quiet: bool) -> None:
    """Print the findings about a node, a line each, by kind, and their numbers.

    Args:
        node: The node.
        found: Its examination.
        out: Stream to print to.
        quiet: Leave out parameters that are used as they are.
    """
    print(f"{node.name} ({node.type})", file=out)
    for kind in exam.KINDS:
        if quiet and kind == exam.USED:
            continue
        for finding in found.of(kind):
            place = node.source.place(finding.name)
            name = f"{finding.name}: " if _has_to_be_named(finding) else ""
            print(plain(f"  {kind}: {name}{finding.text}{f'  [{place}]' if place else ''}"), file=out)
    counts = ", ".join(f"{len(found.of(kind))} {kind}" for kind in exam.KINDS if found.of(kind))
    print(f"  {counts or 'nothing to say'}", file=out)


def _has_to_be_named(finding: Finding) -> bool:
    text = finding.text
    return bool(finding.name) and "parameter " not in text and not text.startswith(f"{finding.name}: ")


def _read(options: argparse.Namespace) -> Launch:
    names = [name for name in options.files if ":=" not in name]
    given = [*options.arg, *(text for text in options.files if ":=" in text)]  # as roslaunch takes them
    launch_files = [name for name in names if name.endswith((".launch", ".xml"))]
    if launch_files:
        others = [name for name in names if name not in launch_files]
        if others:
            raise ValueError(f"'{others[0]}' is no launch file and would not be read; name launch files, or YAML files")
        for argument in dict(_pair(text) for text in given):
            check_argument(argument, launch_files)
        all_of_them = Launch([], [])
        for name in launch_files:
            launch = read_launch(name, dict(_pair(text) for text in given))
            all_of_them.nodes.extend(launch.nodes)
            all_of_them.not_read.extend(launch.not_read)
        return all_of_them
    if given:
        raise ValueError(f"'{given[0]}' is an argument of a launch file, and no launch file is named")
    source = ParameterSource()
    for name in names:
        path, _, namespace = name.partition("@")
        read_yaml(path, namespace, source)
        for node in sorted(set(TYPES) & set(source.values)):
            raise ValueError(
                f"'{path}' holds parameters by node, such as {node}'s, and not those of one: check the launch file "
                f"that loads it; as for overrides, $(rospack find mbf_relay)/launch/demo.launch overrides:={path}")
    if not source.values:
        raise ValueError("the files hold no parameters; name a launch file, or YAML files with one node's parameters")
    return Launch([LaunchedNode("the files", _type_of(source.values, options.node), source)], [])


def _type_of(values: Mapping[str, Any], wanted: str) -> str:
    if wanted:
        return wanted
    if any(name in values for name in ("planners", "controllers")):
        return "move_base_flex"
    unknown = AmclParameters.unknown_names(values)
    return "amcl" if len(unknown) < 0.5 * len(values) else "move_base"


def _pair(text: str) -> List[str]:
    name, equals, value = text.partition(":=")
    if not equals:
        raise ValueError(f"'{text}' is no argument of a launch file; it must have the form name:=value")
    return [name, value]


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="check_config.py",
        description="Tell which parameters of a launch file or of YAML files are used, changed, replaced or ignored.",
        epilog="Exit status: 1 where something is refused or doubtful, 2 where nothing could be read, else 0.",
    )
    parser.add_argument(
        "files", nargs="+", metavar="FILE",
        help="launch files with their arguments (name:=value), or YAML files in the order in which they are loaded; "
        "FILE@NS for one loaded with ns=NS",
    )
    parser.add_argument(
        "--arg", action="append", default=[], metavar="NAME:=VALUE",
        help="argument of the launch file; the same as NAME:=VALUE alone"
    )
    parser.add_argument(
        "--node", default="", choices=("", *EXAMINERS),
        help="node that reads the YAML files (default: judged by the names in them)",
    )
    parser.add_argument(
        "--strict", action="store_true", help="exit with status 1 also where anything is not used as it is, or not read"
    )
    parser.add_argument("--quiet", action="store_true", help="do not list parameters that are used as they are")
    return parser.parse_intermixed_args(arguments)
