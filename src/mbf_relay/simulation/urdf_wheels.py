"""Which links of a URDF are wheels, which of them are driven, and how they stand."""

from __future__ import annotations

import math
import re
from typing import Dict, List, NamedTuple, Tuple

import numpy as np

from mbf_relay.simulation.robot import CAR, OMNIDIRECTIONAL
from mbf_relay.simulation.urdf_description import Description, Solid

STEERS = 0.6
"""Angle (rad) by which front wheels swing where their joint has no limit."""
ALONG = 0.9
"""Least share of an axis that counts as across, or as upright."""
ROUND = 0.1
"""Share of its height by which a wheel may be longer or shorter."""
BESIDE = 0.5
"""Share of the way from the middle to the outermost wheel up to which a wheel is a caster's."""
NEAR_GROUND = 0.01
"""Height (m) up to which something stands on the ground."""
WHEEL = re.compile(r"wheel|tyre|tire", re.IGNORECASE)


class Wheel(NamedTuple):
    """A link that rolls.

    Attributes:
        link, joint: Their names.
        place: Its middle in the base, shape (3,).
        radius, width: Metres.
        limit: The joint's (rad/s), 0 for none.
        steering: The link that swings it within limits, empty where none does.
    """

    link: str
    joint: str
    place: np.ndarray
    radius: float
    width: float
    limit: float
    steering: str


def find_wheels(said: Description) -> List[Wheel]:
    """Return the driven and the steered wheels that stand on the ground; all where nobody says which are driven."""
    found = []
    for link, joint in said.joints.items():
        solids = [solid.corners for solid in said.solids if solid.link == link]
        if not solids or _upright(said, link, "continuous"):  # what swings freely is a caster's
            continue
        corners = np.concatenate(solids)
        length, width, height = (float(side) for side in np.ptp(corners, axis=0))
        rolls = joint.get("type") == "continuous" and abs(said.axis(link)[1]) >= ALONG
        if not rolls and not (WHEEL.search(link) and abs(length - height) < ROUND * height):  # one that is only shown
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
    """Return those to the left and those to the right."""
    return [wheel for wheel in wheels if wheel.place[1] > 0.0], [wheel for wheel in wheels if wheel.place[1] <= 0.0]


def in_order(drive: str, wheels: List[Wheel]) -> List[Wheel]:
    """Return the wheels whose turns the simulation tells, in its order; none where it drives another number."""
    left, right = two_sides(wheels)
    if drive != OMNIDIRECTIONAL:
        return left[:1] + right[:1]
    pairs = zip(*(sorted(side, key=lambda wheel: -wheel.place[0]) for side in (left, right)))
    return [wheel for pair in pairs for wheel in pair] if len(left) == len(right) == 2 else []


def _upright(said: Description, link: str, kind: str) -> str:
    """Return the next link above another that a joint of a kind turns about an upright axis; empty for none."""
    link = said.parent(link)
    while link in said.joints:
        if said.joints[link].get("type") == kind and abs(said.axis(link)[2]) > ALONG:
            return link
        link = said.parent(link)
    return ""


def axles(said: Description, drive: str, wheels: List[Wheel], size: np.ndarray) -> Tuple[Dict[str, float], np.ndarray]:
    """Return the group `wheels` of a robot's file, and where its base_link is to be: x, y (m) in the base.

    Args:
        said: The URDF.
        drive: One of DRIVES.
        wheels: Driven or steered.
        size: Of the rest, shape (3,) in metres; tells the wheels of what drives sideways and has none.
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
