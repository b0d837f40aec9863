"""Conversion between outcomes and the result codes of the installed mbf_msgs.

Release 0.4.0 and upstream's master number the outcomes differently, so that a code is looked up by name in the
generated message. A name that the older release lacks is replaced by the nearest it has.
"""

from __future__ import annotations

from enum import Enum
from typing import Any, Dict

FALLBACKS: Dict[str, str] = {  # tried in turn, until the message has the name
    "BLOCKED_START": "INVALID_START",
    "BLOCKED_GOAL": "INVALID_GOAL",
    "BLOCKED_PATH": "NO_VALID_CMD",
    "START_BLOCKED": "FAILURE",
    "GOAL_BLOCKED": "FAILURE",
    "IMPASSABLE": "FAILURE",
    "TF_ERROR": "FAILURE",
    "NOT_INITIALIZED": "INTERNAL_ERROR",
    "OUT_OF_MAP": "FAILURE",
    "MAP_ERROR": "INTERNAL_ERROR",
    "STOPPED": "INTERNAL_ERROR",  # nobody cancelled
    "ROBOT_STUCK": "OSCILLATION",
}


def code_of(outcome: Enum, result_type: Any) -> int:
    """Return the number of an outcome in a result message type.

    Args:
        outcome: A member of one of the outcome enumerations.
        result_type: Generated message class that holds the constants, e.g. mbf_msgs.msg.GetPathResult.
    """
    name = outcome.name
    while not hasattr(result_type, name):
        name = FALLBACKS.get(name, "FAILURE") if name != "FAILURE" else "INTERNAL_ERROR"
    return int(getattr(result_type, name))


def name_of(code: int, result_type: Any) -> str:
    """Return the name of a number in a result message type, or the number as text where it has none."""
    for name, value in vars(result_type).items():
        if name.isupper() and value == code and "RANGE" not in name:
            return str(name)
    return str(code)
