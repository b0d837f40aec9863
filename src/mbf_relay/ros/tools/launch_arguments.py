"""Arguments that launch files declare."""

from __future__ import annotations

from typing import List, Sequence

from mbf_relay import files
from mbf_relay.misspelling import did_you_mean, nearest_of


def arguments_of(path: str) -> List[str]:
    """Return the names of the arguments that a launch file declares; errors as for `parameter_source.read_launch`."""
    root = files.read_xml(path)
    passed_on = {id(argument) for include in root.iter("include") for argument in include}
    return [element.get("name") or "" for element in root.iter("arg") if id(element) not in passed_on]


def check_argument(name: str, paths: Sequence[str]) -> None:
    """Raise ValueError where no launch file declares an argument, which roslaunch would refuse."""
    declared = sorted({argument for path in paths for argument in arguments_of(path)})
    if name not in declared:
        raise ValueError(f"'{name}' is no argument of {', '.join(paths)}{did_you_mean(nearest_of(name, declared))}")
