"""The nodes' YAML parameter files, read without ROS, and changes to them from files and the command line."""

from __future__ import annotations

import copy
import functools
from pathlib import Path
from typing import Any, Dict, Iterable, Mapping, Optional, Sequence, Tuple

from mbf_relay import files
from mbf_relay.files import config_folder as config_folder  # exported: users import it from here
from mbf_relay.misspelling import did_you_mean, nearest_of

FILES = ("simulator", "amcl", "move_base_flex")
"""The nodes that a lockstep episode replaces; each has its file config/NAME.yaml."""

Settings = Dict[str, Dict[str, Any]]
"""Parameters by node, nested as in the files."""


def load_settings(folder: Path) -> Settings:
    """Return the parameters in the nodes' files in `folder`.

    Raises:
        ValueError: A file is missing or malformed.
    """
    return {name: _read(folder / f"{name}.yaml") for name in FILES}


def load_own(path: Path) -> Settings:
    """Return a user's own parameters by node.

    Args:
        path: A node's file, named after it as `move_base_flex.yaml` is, a folder of such files, or a file with the
            nodes' names as its first level.

    Raises:
        ValueError: It cannot be read, is no YAML, or is for none of the nodes in FILES; the text says which.
    """
    if path.is_dir():
        found = {name: _read(path / f"{name}.yaml") for name in FILES if (path / f"{name}.yaml").is_file()}
        if not found:
            raise ValueError(f"folder {path} holds none of {', '.join(f'{name}.yaml' for name in FILES)}")
        return found
    values = _read(path)
    if path.stem in FILES:
        return {path.stem: values}
    strange = sorted(map(str, set(values) - set(FILES)))
    if strange:
        raise ValueError(
            f"parameter file {path} has '{strange[0]}' at its first level; it must be named after a node "
            f"({', '.join(FILES)}), or hold their names with parameters under them"
        )
    values = {name: group for name, group in values.items() if group is not None}  # None: all is commented out
    for name, group in values.items():
        if not isinstance(group, dict):
            raise ValueError(f"parameter file {path} has {group!r} under '{name}'; it must have names and values there")
    return values


def merged(settings: Mapping[str, Any], own: Mapping[str, Any]) -> Dict[str, Any]:
    """Return settings overridden by others, group by group; lists are replaced as a whole."""
    result = copy.deepcopy(dict(settings))
    for name, value in own.items():
        before = result.get(name)
        nested = isinstance(value, Mapping) and isinstance(before, Mapping)
        result[name] = merged(before, value) if nested else copy.deepcopy(value)  # type: ignore[arg-type]
    return result


def own_part(settings: Mapping[str, Any], others: Mapping[str, Any]) -> Dict[str, Any]:
    """Return the part of the settings that others lack or have with another value; the inverse of `merged`."""
    found: Dict[str, Any] = {}
    for name, value in settings.items():
        other = others.get(name)
        if isinstance(value, Mapping) and isinstance(other, Mapping):
            below = own_part(value, other)
            if below:
                found[name] = below
        elif name not in others or value != other:
            found[name] = copy.deepcopy(value)
    return found


def _read(path: Path) -> Dict[str, Any]:
    try:
        values = _parsed(files.read_text(str(path)))
    except OSError as error:
        raise ValueError(f"parameter file {path} cannot be read: {error.strerror}") from error
    except ValueError as error:
        raise ValueError(f"parameter file {path} is no YAML: {error}") from error
    if not isinstance(values, dict):
        raise ValueError(f"parameter file {path} holds no parameters")
    return copy.deepcopy(values)


@functools.lru_cache(maxsize=16)
def _parsed(text: str) -> Any:
    """Return the values of a YAML document, cached as tune.py needs the files for each trial; do not modify them."""
    return files.parse_yaml(text)


def flatten(values: Mapping[str, Any], prefix: str = "") -> Dict[str, Any]:
    """Return every value by its dotted name."""
    result: Dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            result.update(flatten(value, f"{prefix}{name}."))
        else:
            result[f"{prefix}{name}"] = value
    return result


def parse_change(text: str) -> Tuple[str, Any]:
    """Return name and value of a change "a.b=c", the value parsed as YAML.

    Raises:
        ValueError: The text has another form, or its value is no YAML.
    """
    name, equals, value = text.partition("=")
    if not (name.strip() and equals):
        raise ValueError(f"'{text}' is no change of a parameter; it must have the form name.of.parameter=value")
    try:
        return name.strip(), files.parse_yaml(value)
    except ValueError as error:
        raise ValueError(f"'{value}' (for {name}) is no YAML value: {error}") from error


def full_name(name: str, known: Sequence[str]) -> str:
    """Return the known name that is `name`, or the only one that ends with ".name".

    Raises:
        ValueError: There is none, in which case the text suggests the nearest, or there are several.
    """
    if name in known:
        return name
    matches = [candidate for candidate in known if candidate.endswith("." + name)]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise ValueError(f"parameter '{name}' may mean {' or '.join(sorted(matches)[:5])}; write more of its name")
    raise ValueError(f"there is no parameter '{name}'{did_you_mean(_nearest(name, known))}")


def _nearest(name: str, known: Sequence[str]) -> Optional[str]:
    """Return the known name most similar to `name`, compared by as many last parts as `name` has."""
    parts = name.count(".") + 1
    tails = {".".join(candidate.split(".")[-parts:]): candidate for candidate in known}
    nearest = nearest_of(name, tails)
    return tails[nearest] if nearest else None


def change(settings: Settings, changes: Iterable[str], known: Sequence[str]) -> Settings:
    """Return a copy of the settings with changes "a.b=c" applied.

    Args:
        settings: Parameters by node.
        changes: Each "name=value", with the full name or an unambiguous end of it.
        known: The full names of all parameters.

    Raises:
        ValueError: A change is malformed or names no parameter.
    """
    changed = copy.deepcopy(settings)
    for text in changes:
        name, value = parse_change(text)
        *groups, last = full_name(name, known).split(".")
        place: Dict[str, Any] = changed
        for group in groups:
            place = place.setdefault(group, {})
        place[last] = value
    return changed
