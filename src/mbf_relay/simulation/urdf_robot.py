"""A robot out of its URDF, as people have it for Gazebo: what a file of config/robot says, read off links and plugins.

drive, wheels   links that turn about an axis across, or are round and called wheels. Which of them are driven Gazebo's
                plugin says, else transmissions do, else all are. More axles than one, and none that steers, are taken
                for one between them, with casters under all: the physics has no tyres that scrub
body            what may be bumped into of all other links, every joint at zero: each as its outline seen from above
casters         what else reaches down to the ground; one more where a robot on two wheels would tip over
lidar, imu      Gazebo's sensors, else links by such names
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
"""Top speed (m/s) and turn rate (rad/s) among people, where no wheel turns slower at most."""
CASTER, CASTER_MASS = 0.3, 0.02
"""Radius of a caster, as a share of the driven wheels', and its mass (kg)."""
FOOT = 4.0
"""Extent of what stands on the ground, in radii of the wheels, from which it is body that lies there."""
ASIDE = 0.001
"""Way (m) and turn (rad) from the first link to where a robot turns from which these are two frames."""
TURNS = "turning_center"
"""The latter's name."""
STEPS_PER_SECOND = 120
"""Of the physics; every rate divides it."""
DENSITY = 200.0
"""Mass (kg) of a cubic metre of what has none told."""
LARGEST = 50.0
"""Length (m) that no robot has."""
THINNEST, SMALLEST = 0.002, 1e-6
"""Height (m) of a solid at least, and area (m^2) seen from above from which it is one."""
NARROWEST = 0.6
"""View (rad) from which a sensor is a lidar."""
SIDEWAYS = re.compile(r"planar_move|mecanum|omni|holonomic", re.IGNORECASE)
LIDAR = re.compile(r"laser|lidar|scan|sick|hokuyo|velodyne|(?:^|_)lds", re.IGNORECASE)
IMU = re.compile(r"(?:^|_)imu", re.IGNORECASE)


def robot_values(robot: Element, folder: str) -> Tuple[Dict[str, Any], Dict[str, Any]]:
    """Return what a URDF says of a robot, as `robot_file.robot_of` takes it, and attributes of RobotModel beside that.

    Args:
        robot: The URDF's root.
        folder: Where it lies, for meshes.

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
    if len(wheels) > 2:  # those beside the two of the physics
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
    """Return the frame on the ground that a robot turns in: its description's first where that is there, or a new one.

    Controllers take the base for the point that a robot turns about; of one beside that they would see room where the
    robot swings aside.
    """
    first = said.places[said.first]
    place = Frame(first.position - (*middle, ground), first.rotation)
    if math.hypot(*place.position[:2]) < ASIDE and abs(first.flat().theta) < ASIDE:
        return {"frames": {"base_frame": said.first}}
    return {"frames": {"base_frame": TURNS}, "root": said.first, "root_in_base": place}


def _checked(said: Description, drive: str, wheels: List[Wheel], others: List[Solid]) -> np.ndarray:
    """Return the size of a robot but its wheels, shape (3,) in metres; raise ValueError where it is none."""
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
    """Yield the entries of `body`: outlines seen from above, as high as the solids are; none for what has no extent.

    Args:
        said: The URDF; a link's mass is its solids', evenly.
        solids: Of the body.
        ground: Height (m) of the ground in the base.
        middle: Where base_link is to be, shape (2,).
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
    """Return the group `casters`: what stands at places `under`, and one in front and behind where nothing does.

    Args:
        under: Each of shape (3,), in the base.
        wheels, parts: The groups `wheels` and `body`.
        middle: Where base_link is to be, shape (2,).
    """
    places = [(place[:2] - middle).tolist() for place in under]
    ends = np.concatenate([part["polygon"] for part in parts])[:, 0]
    for end in (max(0.0, ends.max()), min(0.0, ends.min())):
        if not any(end * x > 0.0 and abs(x) > 0.25 * abs(end) for x, _ in places):
            places.append([0.8 * float(end), 0.0])
    return [{"at": place, "radius": CASTER * wheels["radius"], "mass": CASTER_MASS} for place in places]


def _sensors_of(said: Description, middle: np.ndarray) -> Tuple[Dict[str, Any], str, str]:
    """Return where lidar and inertial sensor are and what the lidar measures, and the frames of both, or one empty."""
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
    """Return the lidar's link, and Gazebo's sensor where it has one: of several the first with the fewest layers.

    What looks less than NARROWEST far to the sides tells of a cliff, or is a sonar.
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
    return next((name for name in named if name not in holding), named[0]), None  # not its mount


def _beams(said: Description, sensor: Element) -> Dict[str, Any]:
    """Return what the simulator's parameters of the lidar are for a sensor of Gazebo."""
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
    """Return a finite number that stands somewhere below an element, else the default."""
    found = element.find(path)
    try:
        value = float(found.text or "") if found is not None else default
    except ValueError:
        return default
    return value if math.isfinite(value) else default


def _place(frame: Frame, middle: np.ndarray) -> Dict[str, Any]:
    x, y, z = frame.position
    return {"at": [float(x - middle[0]), float(y - middle[1]), float(z)], "yaw": frame.flat().theta}
