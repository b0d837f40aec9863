"""Derives a robot, as a file in config/robot describes one, from a URDF made for Gazebo.

drive, wheels   Links with a continuous joint about the y axis, or round links that are named wheels. Driven are those
                of Gazebo's plugin, else those with transmissions, else all. Several axles without steering (skid steer)
                become one axle in their middle, with casters below all wheels, as the physics has no sideways slip.
body            Collision geometries of all other links, with every joint at zero, as prisms on their outlines.
casters         Small solids that reach down to the ground; more where a robot on two wheels would tip over.
lidar, imu      Gazebo's sensors, else links with such names.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from typing import Any, Dict, Iterator, List, Optional, Tuple
from xml.etree.ElementTree import Element

import numpy as np

from mbf_relay.geometry import convex_hull, polygon_area
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.robot import CAR, DIFFERENTIAL, OMNIDIRECTIONAL
from mbf_relay.simulation.sdf import pose_of
from mbf_relay.simulation.urdf_description import Description, Solid
from mbf_relay.simulation.urdf_wheels import NEAR_GROUND, Wheel, axles, find_wheels, in_order, two_sides

SPEED, TURN = 0.5, 3.0
"""Top speed (m/s) and turn rate (rad/s), a pace for indoors, unless the wheels' joint limits are lower."""
CASTER, CASTER_MASS = 0.3, 0.02
"""Radius of a caster relative to the driven wheels', and its mass (kg)."""
FOOT = 4.0
"""Extent, in radii of the wheels, from which on a solid that reaches the ground is body and not a caster."""
ASIDE = 0.001
"""Distance (m) and angle (rad) from the root link to the turning centre that give the latter a frame of its own."""
TURNS = "turning_center"
"""Name of that frame."""
STEPS_PER_SECOND = 120
"""Default physics_rate, which the lidar's rate must divide."""
DENSITY = 200.0
"""Density (kg/m^3) of links without a mass."""
LARGEST = 50.0
"""Largest size (m) of a robot; larger ones are described in millimetres."""
THINNEST, SMALLEST = 0.002, 1e-6
"""Least height (m) of a part, and the area (m^2) seen from above below which a solid is left out."""
NARROWEST = 0.6
"""Field of view (rad) above which a ray sensor is a lidar, and not a sonar or cliff sensor."""
SIDEWAYS = re.compile(r"planar_move|mecanum|omni|holonomic", re.IGNORECASE)
"""Plugins of omnidirectional drives."""
LIDAR = re.compile(r"laser|lidar|scan|sick|hokuyo|velodyne|(?:^|_)lds", re.IGNORECASE)
"""Names of lidars' links."""
IMU = re.compile(r"(?:^|_)imu", re.IGNORECASE)
"""Names of IMUs' links."""


def robot_values(robot: Element, folder: str) -> Tuple[Dict[str, Any], Dict[str, Any]]:
    """Return a robot's values for `robot_file.robot_of`, and further attributes of RobotModel, from a URDF.

    Args:
        robot: The URDF's root element.
        folder: Folder of the file, for meshes.

    Raises:
        ValueError: It has no wheels, no body or no lidar, a mesh is missing, or it is malformed; the text says what.
    """
    said = Description(robot, folder)
    wheels = find_wheels(said)
    is_car = any(wheel.steering for wheel in wheels)
    drive = OMNIDIRECTIONAL if SIDEWAYS.search(said.plugins) else CAR if is_car else DIFFERENTIAL
    rolling = {wheel.link for wheel in wheels}
    others = [solid for solid in said.solids if solid.link not in rolling]
    size = _checked(said, drive, wheels, others)
    group, middle = axles(said, drive, wheels, size)
    ground = min([wheel.place[2] - wheel.radius for wheel in wheels] or [solid.low for solid in others])
    stand = [
        solid.low < ground + NEAR_GROUND and np.ptp(solid.corners[:, :2], axis=0).max() < FOOT * group["radius"]
        for solid in others]
    solids = [solid for solid, stands in zip(others, stand) if not stands] or others
    under = [solid.middle for solid, stands in zip(others, stand) if stands]
    if len(wheels) > 2:  # the physics of a differential drive has two; the others become body and casters
        solids = solids + [solid for solid in said.solids if solid.link in rolling]
        under += [wheel.place for wheel in wheels]
    parts = list(_parts(said, solids, ground, middle))
    if not parts:
        raise ValueError("nothing of its body has a length, a width and a height")
    told = in_order(drive, [wheel for wheel in wheels if drive != CAR or not wheel.steering])
    speed = min([SPEED] + [wheel.limit * wheel.radius for wheel in wheels if wheel.limit > 0.0])
    values: Dict[str, Any] = dict(
        drive=drive, base_height=-ground, wheels=group, body=parts, max_speed=speed,
        max_turn_rate=min(TURN, 2.0 * speed / group["separation"]),
        wheel_torque=max(0.5, 2.0 * sum(part["mass"] for part in parts) * group["radius"]),
    )
    if drive == DIFFERENTIAL:
        values["casters"] = _casters(under, group, parts, middle)
    sensors, scan_frame, imu_frame = _sensors_of(said, middle)
    names = _base(said, ground, middle)
    names["frames"].update(scan_frame=scan_frame, **({"imu_frame": imu_frame} if imu_frame else {}))
    joints = tuple(wheel.joint for wheel in told)
    return {**values, **sensors}, {
        **names, "joint_names": joints, "still_joints": said.movable(joints), "warnings": tuple(said.warnings)}


def _base(said: Description, ground: float, middle: np.ndarray) -> Dict[str, Any]:
    """Return the base frame, as attributes of RobotModel: the root link if it is at the turning centre, or a new one.

    Controllers assume that the robot turns about its base frame. With another one they would not see how its far end
    swings out.
    """
    first = said.places[said.first]
    place = Frame(first.position - (*middle, ground), first.rotation)
    if math.hypot(*place.position[:2]) < ASIDE and abs(first.flat().theta) < ASIDE:
        return {"frames": {"base_frame": said.first}}
    return {"frames": {"base_frame": TURNS}, "root": said.first, "root_in_base": place}


def _checked(said: Description, drive: str, wheels: List[Wheel], others: List[Solid]) -> np.ndarray:
    """Return the size of a robot without its wheels, shape (3,) in metres.

    Raises:
        ValueError: It has no body, no wheels on both sides, or is too large.
    """
    if not others:
        raise ValueError("no link but its wheels has a <collision> or <visual> that can be read")
    if drive != OMNIDIRECTIONAL and not all(two_sides(wheels)):
        names = ", ".join(sorted(joint.get("name", "") for joint in said.joints.values())) or "none"
        raise ValueError(
            "it has no two wheels, one to each side: round links called so, or such as turn by a continuous joint "
            f"about an axis across; its joints: {names}")
    size: np.ndarray = np.ptp(np.concatenate([solid.corners for solid in others]), axis=0)
    if size.max() > LARGEST:
        raise ValueError(
            f"its links reach over {size.max():.4g} m; lengths are in metres, and a mesh in millimetres needs "
            'scale="0.001 0.001 0.001"')
    return size


def _parts(said: Description, solids: List[Solid], ground: float, middle: np.ndarray) -> Iterator[Dict[str, Any]]:
    """Yield the entries of `body`: a prism on the convex outline of each solid that has an extent.

    Args:
        said: The URDF; a link's mass is divided equally among its solids.
        solids: The solids of the body.
        ground: Height (m) of the ground in the base.
        middle: x, y (m) of the simulation's base_link in the base, shape (2,).
    """
    of_link = Counter(solid.link for solid in solids)
    for solid in solids:
        hull = convex_hull(solid.corners[:, :2] - middle)
        low, high = max(solid.low, ground + NEAR_GROUND), float(solid.corners[:, 2].max())
        area = polygon_area(hull)
        if len(hull) >= 3 and area > SMALLEST and high > low:
            height = max(THINNEST, high - low)
            mass = said.masses.get(solid.link, 0.0) / of_link[solid.link]
            yield {
                "polygon": hull.tolist(), "height": height, "at": [0.0, 0.0, low + 0.5 * height],
                "mass": mass if mass > 0.0 else DENSITY * area * height}


def _casters(
    under: List[np.ndarray], wheels: Dict[str, float], parts: List[Dict[str, Any]], middle: np.ndarray
) -> List[Dict[str, Any]]:
    """Return the entries of `casters`: one at each place in `under`, and one in front and behind where there is none.

    Args:
        under: Places of casters, each of shape (3,) in metres, in the base.
        wheels, parts: The entries `wheels` and `body`.
        middle: x, y (m) of the simulation's base_link in the base, shape (2,).
    """
    places = [(place[:2] - middle).tolist() for place in under]
    ends = np.concatenate([part["polygon"] for part in parts])[:, 0]
    for end in (max(0.0, ends.max()), min(0.0, ends.min())):
        if not any(end * x > 0.0 and abs(x) > 0.25 * abs(end) for x, _ in places):
            places.append([0.8 * float(end), 0.0])
    return [{"at": place, "radius": CASTER * wheels["radius"], "mass": CASTER_MASS} for place in places]


def _sensors_of(said: Description, middle: np.ndarray) -> Tuple[Dict[str, Any], str, str]:
    """Return values of the lidar and the IMU, and the frames of both; the IMU's is empty where there is none."""
    link, sensor = _lidar(said)
    frame, told, values = said.places[link], "", {}
    if sensor is not None:
        frame, told = frame.compose(pose_of(sensor)), sensor.findtext("plugin/frameName", "").strip(" /")
        values = _beams(said, sensor)
    values["lidar"] = _place(frame, middle)
    felt = [name for name, _ in _sensors(said, ("imu",))] + [name for name in said.places if IMU.search(name)]
    if felt:
        values["imu"] = _place(said.places[felt[0]], middle)
    return values, told or link, felt[0] if felt else ""


def _sensors(said: Description, kinds: Tuple[str, ...]) -> Iterator[Tuple[str, Element]]:
    for group in said.root.iterfind("gazebo"):
        for sensor in group.iterfind("sensor"):
            if sensor.get("type") in kinds and group.get("reference") in said.places:
                yield group.get("reference", ""), sensor


def _lidar(said: Description) -> Tuple[str, Optional[Element]]:
    """Return the lidar's link, and Gazebo's sensor where there is one: of several, the first with the fewest layers.

    Sensors with a view up to NARROWEST are cliff sensors or sonars.
    """
    told = _sensors(said, ("ray", "gpu_ray", "lidar", "gpu_lidar"))
    sensors = [one for one in told if np.ptp(_view(one[1])) > NARROWEST]
    if sensors:
        return min(sensors, key=lambda one: _number(one[1], ".//vertical/samples", 1.0))
    named = [name for name in said.places if LIDAR.search(name)]
    if not named:
        raise ValueError(
            "it has no lidar: no sensor of type ray in a <gazebo> of a link, and no link called laser, lidar or scan; "
            "add such a link where it is")
    holding = {said.parent(name) for name in said.places}
    return next((name for name in named if name not in holding), named[0]), None  # a leaf, rather than its mount


def _beams(said: Description, sensor: Element) -> Dict[str, Any]:
    """Return the simulator's parameters of the lidar for a Gazebo sensor."""
    first, last = _view(sensor)
    view = min(2.0 * math.pi, abs(last - first))
    if view < 2.0 * math.pi - 0.1 and abs(first + last) > 0.1:
        said.warnings.append(
            f"its lidar looks from {first:.2f} to {last:.2f} rad; as far to both sides is simulated")
    beams = max(1, round(_number(sensor, ".//horizontal/samples", 360.0) * 2.0 * math.pi / view))
    steps = max(1, math.ceil(STEPS_PER_SECOND / max(0.1, _number(sensor, "update_rate", 10.0))))
    nearest, farthest = (_number(sensor, f".//range/{end}", value) for end, value in (("min", 0.12), ("max", 10.0)))
    return dict(
        scan_rate=STEPS_PER_SECOND / steps, scan_beams=min(beams, 16384), scan_view=view,
        scan_range_min=max(0.0, nearest), scan_range_max=max(farthest, nearest + 0.1),
        scan_resolution=max(0.0, _number(sensor, ".//range/resolution", 0.0)),
        scan_noise=max(0.0, _number(sensor, ".//noise/stddev", 0.0)))


def _view(sensor: Element) -> Tuple[float, float]:
    """Return the directions (rad) of a sensor's first and last beam."""
    ends = (("min", -math.pi), ("max", math.pi))
    first, last = (_number(sensor, f".//horizontal/{end}_angle", angle) for end, angle in ends)
    return first, last


def _number(element: Element, path: str, default: float) -> float:
    """Return the finite number in the element at `path`, else the default."""
    found = element.find(path)
    try:
        value = float(found.text or "") if found is not None else default
    except ValueError:
        return default
    return value if math.isfinite(value) else default


def _place(frame: Frame, middle: np.ndarray) -> Dict[str, Any]:
    x, y, z = frame.position
    return {"at": [float(x - middle[0]), float(y - middle[1]), float(z)], "yaw": frame.flat().theta}
