"""Validation of the messages that browsers send."""

from __future__ import annotations

import json
import math
from typing import Any, Callable, Dict, List, NamedTuple

from mbf_relay.geometry import Pose2D

LONGEST = 8192
"""Largest length (characters) of a message; the longest valid one, a list of waypoints, is shorter."""
FARTHEST = 1e5
"""Largest coordinate (m): no map is larger, and float32 would round beyond."""
WAYPOINTS = 50
"""Largest number of waypoints."""
LONGEST_PAUSE = 3600.0
"""Longest pause (s) at a waypoint."""
LARGEST_SPREAD = 10.0
"""Largest standard deviation (m) of a pose estimate; beyond, global localization is what is needed."""
FASTEST_LAYER = 60.0
"""Largest rate (Hz) of a layer, the usual refresh rate of screens."""


class Refused(ValueError):
    """A message is invalid; the text tells the user why."""


class Wish(NamedTuple):
    """A valid message of a browser.

    Attributes:
        name: The command, a key of LOOKING or DRIVING.
        values: Its fields, all that the command has, checked.
    """

    name: str
    values: Dict[str, Any]


def number(low: float, high: float) -> Callable[[Any], float]:
    """Return a check for a finite number from `low` to `high`."""
    def check(value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) < math.inf:
            raise Refused("must be a finite number")
        if not low <= value <= high:
            raise Refused(f"must lie between {low:g} and {high:g}")
        return float(value)

    return check


def flag(value: Any) -> bool:
    """Return a boolean; raise Refused for anything else."""
    if not isinstance(value, bool):
        raise Refused("must be true or false")
    return value


def text(longest: int) -> Callable[[Any], str]:
    """Return a check for a string of at most `longest` characters."""
    def check(value: Any) -> str:
        if not isinstance(value, str) or len(value) > longest:
            raise Refused(f"must be a text of at most {longest} characters")
        return value

    return check


PLACE = number(-FARTHEST, FARTHEST)
"""Checks a coordinate (m)."""
TURN = number(-2.0 * math.pi, 2.0 * math.pi)
"""Checks an angle (rad)."""


def poses(value: Any) -> List[Pose2D]:
    """Return a list of waypoints from [[x, y, heading], ...]; raise Refused where it is invalid."""
    if not isinstance(value, list) or not 1 <= len(value) <= WAYPOINTS:
        raise Refused(f"must be a list of 1 to {WAYPOINTS} poses")
    if not all(isinstance(entry, list) and len(entry) == 3 for entry in value):
        raise Refused("must hold poses of three numbers")
    return [Pose2D(PLACE(x), PLACE(y), TURN(theta)) for x, y, theta in value]


def rates(value: Any) -> Dict[str, float]:
    """Return the wanted rate (Hz) of each layer; raise Refused where one is invalid."""
    if not isinstance(value, dict) or len(value) > 40 or not all(len(name) <= 40 for name in value):
        raise Refused("must name at most 40 layers with their rates")
    rate = number(0.01, FASTEST_LAYER)
    return {name: rate(hertz) for name, hertz in value.items()}


Fields = Dict[str, Callable[[Any], Any]]
"""The check of each field of a message."""
POSE: Fields = {"x": PLACE, "y": PLACE, "theta": TURN}
"""The fields of a pose."""

LOOKING: Dict[str, Fields] = {
    "hello": {"token": text(200), "robot": text(200)},
    "ack": {"number": number(0, 2 ** 32)},
    "show": {"layers": rates},
    "robot": {"name": text(200)},
    "ping": {"time": number(0.0, 1e15)},
}
"""Commands that need the right to view."""

DRIVING: Dict[str, Fields] = {
    "goal": POSE,
    "tour": {"waypoints": poses, "loop": flag, "pause": number(0.0, LONGEST_PAUSE)},
    "cancel": {},
    "pose": {**POSE, "spread": number(0.001, LARGEST_SPREAD), "turn_spread": number(0.001, math.pi)},
    "clear": {},
    "stick": {"forward": number(-1.0, 1.0), "left": number(-1.0, 1.0)},
    "release": {},
    "record": {"on": flag},
    "reset": {},
    "obstacle": {"x": PLACE, "y": PLACE, "size": number(0.02, 5.0)},
    "remove_obstacles": {},
}
"""Commands that move the robot or change its localization, costmaps or world; they need the right to drive."""


def wish_from(message: Any) -> Wish:
    """Return the validated message.

    Raises:
        Refused: It is too long, no JSON object, has an unknown command, or a field is missing, unknown or out of range.
    """
    if not isinstance(message, str):
        raise Refused("a message must be text")
    if len(message) > LONGEST:
        raise Refused(f"a message must have at most {LONGEST} characters; this one has {len(message)}")
    try:
        values = json.loads(message)
    except (ValueError, RecursionError) as error:
        raise Refused("a message must be JSON") from error
    if not isinstance(values, dict):
        raise Refused("a message must be a JSON object")
    name = values.pop("do", None)
    known = {**LOOKING, **DRIVING}
    if not isinstance(name, str) or name not in known:
        raise Refused(f"nothing is known by the name {str(name)[:40]!r}")
    fields = known[name]
    if set(values) != set(fields):
        raise Refused(
            f"'{name}' has the fields {', '.join(sorted(fields)) or 'none'}; got "
            f"{', '.join(sorted(values))[:80] or 'none'}"
        )
    return Wish(name, {key: _checked(name, key, check, values[key]) for key, check in fields.items()})


def _checked(name: str, key: str, check: Callable[[Any], Any], value: Any) -> Any:
    try:
        return check(value)
    except Refused as error:
        raise Refused(f"{name}: {key} {error}") from error
