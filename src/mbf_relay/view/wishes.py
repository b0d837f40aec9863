"""What a browser may ask for, judged before anything comes of it."""

from __future__ import annotations

import json
import math
from typing import Any, Callable, Dict, List, NamedTuple

from mbf_relay.geometry import Pose2D

LONGEST = 8192
"""Characters of a wish at most; the longest, a list of waypoints, stays under it."""
FARTHEST = 1e5
"""Metres from the map's origin at most: what lies beyond no map has, and 32-bit messages would round it."""
WAYPOINTS = 50
LONGEST_PAUSE = 3600.0
LARGEST_SPREAD = 10.0
"""Metres of deviation of a pose estimate at most; who knows less wants a global localization."""
FASTEST_LAYER = 60.0
"""Parts per second at most; faster than a screen draws."""


class Refused(ValueError):
    """A wish that is not carried out; the text tells the person why."""


class Wish(NamedTuple):
    """One message of a browser.

    Attributes:
        name: What is asked.
        values: Its fields, checked: all that the name has, and nothing else.
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
    """Return a boolean, or refuse."""
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
TURN = number(-2.0 * math.pi, 2.0 * math.pi)


def poses(value: Any) -> List[Pose2D]:
    """Return a list of waypoints, each [x, y, heading]."""
    if not isinstance(value, list) or not 1 <= len(value) <= WAYPOINTS:
        raise Refused(f"must be a list of 1 to {WAYPOINTS} poses")
    if not all(isinstance(entry, list) and len(entry) == 3 for entry in value):
        raise Refused("must hold poses of three numbers")
    return [Pose2D(PLACE(x), PLACE(y), TURN(theta)) for x, y, theta in value]


def rates(value: Any) -> Dict[str, float]:
    """Return layers with how often (Hz) each is wanted."""
    if not isinstance(value, dict) or len(value) > 40 or not all(len(name) <= 40 for name in value):
        raise Refused("must name at most 40 layers with their rates")
    rate = number(0.01, FASTEST_LAYER)
    return {name: rate(hertz) for name, hertz in value.items()}


Fields = Dict[str, Callable[[Any], Any]]
POSE: Fields = {"x": PLACE, "y": PLACE, "theta": TURN}

LOOKING: Dict[str, Fields] = {
    "hello": {"token": text(200), "robot": text(200)},
    "ack": {"number": number(0, 2 ** 32)},
    "show": {"layers": rates},
    "robot": {"name": text(200)},
    "ping": {"time": number(0.0, 1e15)},
}
"""What everyone may ask who may look."""

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
"""What moves the robot or changes what it believes, and needs the right to drive."""


def wish_from(message: Any) -> Wish:
    """Return what a message asks for.

    Raises:
        Refused: It is no JSON object, too long, asks for nothing known, or a field is missing, unknown or out of range.
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
