"""The nodes' own YAML files, read without ROS, and changes to them from the command line."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any, Dict, Iterable, Mapping, Optional, Sequence, Tuple

import yaml

from mbf_relay.parameters import did_you_mean, nearest_of

FILES = ("simulator", "amcl", "move_base_flex")
"""The nodes that a lockstep episode stands in for; each has its file config/NAME.yaml."""

Settings = Dict[str, Dict[str, Any]]
"""Parameters by node, nested as in the files."""


def config_folder() -> Path:
    """Return the package's config folder: of the source tree, or of the install space this module lies in.

    Raises:
        ValueError: There is none; the package is not installed as a whole.
    """
    here = Path(__file__).resolve()
    candidates = [here.parents[3] / "config"]
    if len(here.parents) > 5:
        candidates.append(here.parents[5] / "share" / "mbf_relay" / "config")
    for folder in candidates:
        if (folder / "move_base_flex.yaml").is_file():
            return folder
    raise ValueError(f"the package's config folder was not found; looked for {' and '.join(map(str, candidates))}")


def load_settings(folder: Path) -> Settings:
    """Return what the nodes' files in `folder` say.

    Raises:
        ValueError: A file is missing or malformed.
    """
    settings = {}
    for name in FILES:
        path = folder / f"{name}.yaml"
        try:
            values = yaml.safe_load(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise ValueError(f"parameter file {path} cannot be read: {error.strerror}") from error
        except yaml.YAMLError as error:
            raise ValueError(f"parameter file {path} is no YAML: {' '.join(str(error).split())}") from error
        if not isinstance(values, dict):
            raise ValueError(f"parameter file {path} holds no parameters")
        settings[name] = values
    return settings


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
    """Return name and value of a change "a.b=c", the value read as YAML.

    Raises:
        ValueError: It has no such form.
    """
    name, equals, value = text.partition("=")
    if not (name.strip() and equals):
        raise ValueError(f"'{text}' is no change of a parameter; it must have the form name.of.parameter=value")
    try:
        return name.strip(), yaml.safe_load(value)
    except yaml.YAMLError as error:
        raise ValueError(f"'{value}' (for {name}) is no YAML value: {' '.join(str(error).split())}") from error


def full_name(name: str, known: Sequence[str]) -> str:
    """Return the known name that `name` means: itself, or the only one that ends with it.

    Raises:
        ValueError: There is none, or several; the text names the nearest.
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
    """Return the known name that looks most like `name` in as many of its last parts as `name` has."""
    parts = name.count(".") + 1
    tails = {".".join(candidate.split(".")[-parts:]): candidate for candidate in known}
    nearest = nearest_of(name, tails)
    return tails[nearest] if nearest else None


def change(settings: Settings, changes: Iterable[str], known: Sequence[str]) -> Settings:
    """Return a copy of the settings with changes "a.b=c" made.

    Args:
        settings: Parameters by node.
        changes: Each a name, full or as much of its end as is unambiguous, and a value.
        known: The full names of all parameters there are.

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
