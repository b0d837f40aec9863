"""What a node has in the graph, beside what upstream's has there, and the README's table of the differences."""

import re
from fnmatch import fnmatch
from pathlib import Path
from typing import Dict, Iterable, List, Set, Tuple

import rosgraph
import rosservice
import yaml

TEST = Path(__file__).resolve().parent
UPSTREAM = yaml.safe_load((TEST / "system" / "upstream_graph.yaml").read_text(encoding="utf-8"))
README = TEST.parent / "launch" / "README.md"
RECONFIGURED = ("parameter_descriptions", "parameter_updates", "set_parameters")
"""By which a dynamic_reconfigure server is known."""

Graph = Dict[str, Dict[str, str]]


def graph_of(node: str) -> Graph:
    """Return what a node publishes, subscribes and serves, each name with its type, and where it reconfigures."""
    master = rosgraph.Master("/graph_of")
    types = dict(master.getTopicTypes())
    publishers, subscribers, services = master.getSystemState()
    found = {
        "publishes": {name: types[name] for name, nodes in publishers if node in nodes},
        "subscribes": {name: types[name] for name, nodes in subscribers if node in nodes},
        "serves": {name: rosservice.get_service_type(name) for name, nodes in services if node in nodes},
    }
    servers = {name.rsplit("/", 1)[0] for name in found["serves"] if name.endswith(f"/{RECONFIGURED[-1]}")}
    for names in found.values():
        for name in [name for name in names if name.rsplit("/", 1)[1] in RECONFIGURED]:
            del names[name]
    return {**found, "reconfigures": dict.fromkeys(servers, "")}


def upstream_graph(node: str, more: str = "") -> Graph:
    """Return the same of upstream's node; with `more` that part of the list alone."""
    listed = UPSTREAM[more] if more else UPSTREAM
    return {
        kind: {resolved(name, node): type_ for name, type_ in dict(names).items()}
        for kind, names in {**listed, "reconfigures": dict.fromkeys(listed["reconfigures"], "")}.items()
        if kind in ("publishes", "subscribes", "serves", "reconfigures")
    }


def resolved(name: str, node: str) -> str:
    """Return a name as the master knows it."""
    if name.startswith("~"):
        return f"{node}/{name[1:]}".rstrip("/")
    return name if name.startswith("/") else f"/{name}"


def differences(ours: Graph, theirs: Graph) -> Set[Tuple[str, str, str]]:
    """Return (kind, name, which) of all that only one of two has, or has with another type."""
    found = set()
    for kind in theirs:
        found |= {(kind, name, "not here") for name in set(theirs[kind]) - set(ours[kind])}
        found |= {(kind, name, "only here") for name in set(ours[kind]) - set(theirs[kind])}
        found |= {(kind, name, "another type") for name in set(ours[kind]) & set(theirs[kind])
                  if ours[kind][name] != theirs[kind][name] and not is_ambiguous(kind, name, theirs)}
    return found


def is_ambiguous(kind: str, name: str, graph: Graph) -> bool:
    """Return whether a graph has two types of one topic, of which the master keeps one."""
    return kind != "serves" and graph["publishes"].get(name, "") != graph["subscribes"].get(name, "")


def rows_of_readme() -> List[Tuple[str, str, str]]:
    """Return (kind, pattern, which) of each row of the README's table that gives a reason."""
    rows = re.findall(r"^\| (\w+) (`.*?`) \| ([\w ]+) \| \S.* \|$", README.read_text(encoding="utf-8"), re.MULTILINE)
    return [(kind, pattern, which) for kind, names, which in rows for pattern in re.findall(r"`(.*?)`", names)]


def unexplained(found: Iterable[Tuple[str, str, str]], node: str) -> List[str]:
    """Return what differs without a row of the README's table, and rows that nothing differs by."""
    rows = dict.fromkeys(rows_of_readme(), 0)
    problems = []
    for kind, name, which in found:
        matching = [row for row in rows if (row[0], row[2]) == (kind, which) and
                    fnmatch(name, row[1] if kind == "says" else resolved(row[1], node))]
        for row in matching:
            rows[row] += 1
        if not matching:
            problems.append(f"{kind} {name}: {which}, and the README does not say why")
    return sorted(problems) + [f"the README says of {row}, which is not so" for row, count in rows.items() if not count]
