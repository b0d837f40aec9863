"""tf_prefix, the parameter that stood before the names of all frames until nodes used tf2."""

from __future__ import annotations

from typing import Any


def ignored_prefix(place: str, value: Any, base_frame: str) -> str:
    """Return what is said of a tf_prefix with which the robot's frame does not begin; empty where it does.

    Nodes that use tf2 ignore it, while robot_state_publisher does not. Whoever relies on it waits for frames that
    nobody publishes.

    Args:
        place: Full name of the parameter.
        value: Its value.
        base_frame: Frame of the robot's base.
    """
    prefix = str(value).strip("/")
    if not prefix or base_frame.startswith(f"{prefix}/"):
        return ""
    return (f"{place} is '{prefix}' and is ignored, as by every node that uses tf2: the robot's frame is "
            f"'{base_frame}'; if you mean '{prefix}/{base_frame}', put the prefix into the parameters of all frames")
