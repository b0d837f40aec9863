"""Finds the wheels of a URDF, which of them are driven or steered, and their arrangement."""

from __future__ import annotations

import math
import re
from typing import Dict, List, NamedTuple, Tuple

import numpy as np

from mbf_relay.simulation.robot import CAR, OMNIDIRECTIONAL
from mbf_relay.simulation.urdf_description import Description, Solid

STEERS = 0.6
"""Steering angle (rad) of front wheels whose joint has no limit."""
ALONG = 0.9
"""Least component of a unit axis along y, or z, to count as parallel to it."""
ROUND = 0.1
"""Largest relative difference between length and height of a wheel."""
BESIDE = 0.5
"""Lateral offset, relative to the outermost wheel's, up to which a wheel is a caster's."""
NEAR_GROUND = 0.01
"""Height (m) above the ground up to which something counts as standing on it."""
WHEEL = re.compile(r"wheel|tyre|tire", re.IGNORECASE)
"""Names of wheels' links."""


class Wheel(NamedTuple):
    """A wheel.

    Attributes:
        link, joint: Names of its link and joint.
        place: Its centre in the base, shape (3,) in metres.
        radius, width: Metres.
        limit: Velocity limit of the joint (rad/s), 0 for none.
        steering: The link above it with a steering joint, empty where it has none.
    """

    link: str
    joint: str
    place: np.ndarray
    radius: float
    width: float
    limit: float
    steering: str


def find_wheels(said: Description) -> List[Wheel]:
    """Return the driven and the steered wheels on the ground; all wheels where it is not said which are driven."""
    found = []
    for link, joint in said.joints.items():
        solids = [solid.corners for solid in said.solids if solid.link == link]
        if not solids or _upright(said, link, "continuous"):  # a wheel that swivels freely is a caster's
            continue
        corners = np.concatenate(solids)
        length, width, height = (float(side) for side in np.ptp(corners, axis=0))
        rolls = joint.get("type") == "continuous" and abs(said.axis(link)[1]) >= ALONG
        if not rolls and not (WHEEL.search(link) and abs(length - height) < ROUND * height):  # with a fixed joint
            continue
        middle = Solid(link, corners).middle
        limit, steering = said.limit(link, "velocity"), _upright(said, link, "revolute")
        found.append(Wheel(link, joint.get("name", ""), middle, 0.5 * height, width, limit, steering))
    ground = min((wheel.place[2] - wheel.radius for wheel in found), default=0.0)
    aside = max((abs(wheel.place[1]) for wheel in found), default=0.0)
    found = [
        wheel for wheel in found if wheel.place[2] - wheel.radius < ground + NEAR_GROUND < wheel.place[2]
        and abs(wheel.place[1]) > BESIDE * aside]
    for named in (said.words, {element.get("name", "") for element in said.root.iterfind("transmission/joint")}):
        if all(two_sides([wheel for wheel in found if wheel.joint in named])):
            return [wheel for wheel in found if wheel.joint in named or wheel.steering]
    return found


def two_sides(wheels: List[Wheel]) -> Tuple[List[Wheel], List[Wheel]]:
    """Return the wheels on the left and those on the right."""
    return [wheel for wheel in wheels if wheel.place[1] > 0.0], [wheel for wheel in wheels if wheel.place[1] <= 0.0]


def in_order(drive: str, wheels: List[Wheel]) -> List[Wheel]:
    """Return the wheels whose joints the simulation publishes, in its order; none where it has another number."""
    left, right = two_sides(wheels)
    if drive != OMNIDIRECTIONAL:
        return left[:1] + right[:1]
    pairs = zip(*(sorted(side, key=lambda wheel: -wheel.place[0]) for side in (left, right)))
    return [wheel for pair in pairs for wheel in pair] if len(left) == len(right) == 2 else []


def _upright(said: Description, link: str, kind: str) -> str:
    """Return the nearest ancestor of a link whose joint has a type and a vertical axis; empty for none."""
    link = said.parent(link)
    while link in said.joints:
        if said.joints[link].get("type") == kind and abs(said.axis(link)[2]) > ALONG:
            return link
        link = said.parent(link)
    return ""


def axles(said: Description, drive: str, wheels: List[Wheel], size: np.ndarray) -> Tuple[Dict[str, float], np.ndarray]:
    """Return the entry `wheels` of a robot's file, and x, y (m) of the simulation's base_link in the base, shape (2,).

    Args:
        said: The URDF.
        drive: One of DRIVES.
        wheels: The driven and the steered wheels.
        size: Size of the body, shape (3,) in metres, from which wheels are made up for an omnidirectional robot
            without any.

    Raises:
        ValueError: All wheels steer, or they steer behind.
    """
    steered = [wheel for wheel in wheels if wheel.steering]
    rolling = [wheel for wheel in wheels if not wheel.steering] if drive == CAR else wheels
    left, right = two_sides(rolling)
    ends = [wheel.place[0] for wheel in wheels]
    if drive == OMNIDIRECTIONAL and not (left and right and np.ptp(ends) > 0.0):
        length, across = float(size[0]), float(size[1])
        radius = 0.12 * min(length, across)
        return dict(radius=radius, width=0.1 * radius, separation=0.6 * across, base=0.6 * length), np.zeros(2)
    if not (left and right):
        raise ValueError("all its wheels steer, and a car has two that do not")
    sides = [float(np.mean([wheel.place[1] for wheel in side])) for side in (left, right)]
    group = dict(
        radius=float(np.median([wheel.radius for wheel in rolling])), separation=sides[0] - sides[1],
        width=max(0.005, float(np.median([wheel.width for wheel in rolling]))),
        mass=max(0.02, float(np.mean([said.masses.get(wheel.link, 0.0) for wheel in rolling]))),
    )
    behind = float(np.mean([wheel.place[0] for wheel in rolling]))
    if drive == CAR:
        group["base"] = float(np.mean([wheel.place[0] for wheel in steered])) - behind
        if group["base"] <= 0.0:
            raise ValueError(f"its wheels that steer are {-group['base']:.3g} m behind the others; cars steer in front")
        swing = min(said.limit(wheel.steering, "upper") for wheel in steered)
        group["turning_radius"] = group["base"] / math.tan(swing if 0.0 < swing < 1.5 else STEERS)
    elif drive == OMNIDIRECTIONAL:
        group["base"] = float(np.ptp(ends))
        behind = 0.5 * (min(ends) + max(ends))
    return group, np.array([behind, 0.5 * sum(sides)])
