"""The model of a robot: body, wheels, casters, poses of sensors, outline and footprint."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, List, Mapping, NamedTuple, Tuple

import numpy as np

from mbf_relay.geometry import convex_hull
from mbf_relay.parameters import ParameterSet, parameter
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.shapes import Body, Box, Cylinder, Shape

DIFFERENTIAL, OMNIDIRECTIONAL, CAR = DRIVES = ("differential", "omnidirectional", "car")
"""Kinds of drives."""

SCAN_FRAME, IMU_FRAME, BASE_FRAME, FOOTPRINT_FRAME = "base_scan", "imu_link", "base_link", "base_footprint"
"""Default names of the frames."""
AXLE = Frame.of(0.0, 0.0, roll=-math.pi / 2.0)
"""Rotates a wheel's axis from z to y."""

ROLLED_OVER = 0.01
"""Height (m) up to which bodies are ignored, as the robot rolls over them: thresholds, mats, seams of floors."""
LOWEST_LOOK, STEP_BETWEEN_LOOKS = 0.005, 0.04
"""Lowest height (m) at which the world is cut to test whether the robot fits, and the largest step between heights."""


@dataclass(frozen=True)
class Wheels(ParameterSet):
    """Wheels: two on one axle, or four at the corners of a rectangle, the front ones of a car steering."""

    radius: float = parameter(0.05, "radius of a wheel", unit="m", above=0.0)
    width: float = parameter(0.02, "width of a wheel", unit="m", above=0.0)
    mass: float = parameter(0.05, "mass of a wheel", unit="kg", above=0.0)
    separation: float = parameter(0.2, "distance between the middles of left and right wheels", unit="m", above=0.0)
    base: float = parameter(
        0.0, "distance between front and rear axle; 0 for a differential drive, which has one", unit="m", minimum=0.0)
    turning_radius: float = parameter(
        0.0, "smallest turning radius of a car, at the middle of its rear axle; 0 for a robot that turns on the spot",
        unit="m", minimum=0.0)
    steering_rate: float = parameter(1.5, "how fast a car's front wheels are steered", unit="rad/s", above=0.0)


class Part(NamedTuple):
    """A solid of the body: its shape, its pose in base_link, and its mass (kg)."""

    shape: Shape
    frame: Frame
    mass: float


class Caster(NamedTuple):
    """A caster, modelled as a ball without friction: x, y in base_link and radius (m), mass (kg)."""

    x: float
    y: float
    radius: float
    mass: float


@dataclass(frozen=True, eq=False)
class RobotModel:
    """A robot's geometry and masses, in base_link, which is `base_height` above base_footprint on the ground.

    base_link of a differential drive is between its two wheels, of an omnidirectional one between its four, of a car
    between its rear wheels.

    Attributes:
        name: For messages.
        drive: One of DRIVES.
        base_height: Height (m) of base_link above the ground.
        body: The solids of the body.
        inertia: Moments of inertia of the body about x, y, z (kg m^2).
        wheels: Dimensions and arrangement of the wheels.
        casters: The casters.
        outline: Convex outline of body and wheels seen from above, shape (K, 2) in metres, counter-clockwise, in
            base_footprint.
        footprint: Footprint for navigation, shape (K, 2), likewise.
        scan_in_base, imu_in_base: Poses of the sensors.
        settings: Values of SimulationParameters in the robot's file.
        frames: Names of its frames by parameter (base_frame, scan_frame, imu_frame), where a URDF has its own.
        root, root_in_base: Root link of its URDF where that is not base_frame, else empty; and its pose in base_frame.
        joint_names: Joints of the driven wheels in its URDF, left before right; empty for the default names.
        still_joints: Movable joints of its URDF that are not simulated and published at zero.
        warnings: What was changed or ignored of its file.
    """

    name: str
    drive: str
    base_height: float
    body: Tuple[Part, ...]
    inertia: Tuple[float, float, float]
    wheels: Wheels
    casters: Tuple[Caster, ...]
    outline: np.ndarray
    footprint: np.ndarray
    scan_in_base: Frame
    imu_in_base: Frame
    settings: Mapping[str, Any]
    frames: Mapping[str, str] = field(default_factory=dict)
    root: str = ""
    root_in_base: Frame = Frame.of(0.0, 0.0)
    joint_names: Tuple[str, ...] = ()
    still_joints: Tuple[str, ...] = ()
    warnings: Tuple[str, ...] = ()

    @property
    def axle_height(self) -> float:
        """Height (m) of the wheels' axes above base_link."""
        return round(self.wheels.radius - self.base_height, 9)  # without rounding errors of the subtraction

    @property
    def scan_height(self) -> float:
        """Height (m) of the lidar above the ground."""
        return self.base_height + float(self.scan_in_base.position[2])

    @property
    def height(self) -> float:
        """Height (m) of its highest point above the ground."""
        tops = [part.frame.transform_points(part.shape.triangles().reshape(-1, 3))[:, 2].max() for part in self.body]
        return self.base_height + float(max(tops))

    @property
    def joints(self) -> Tuple[str, ...]:
        """Names of the driven wheels' joints."""
        if self.joint_names:
            return self.joint_names
        if self.drive == OMNIDIRECTIONAL:
            return tuple(f"wheel_{end}_{side}_joint" for end in ("front", "rear") for side in ("left", "right"))
        return "wheel_left_joint", "wheel_right_joint"

    def wheel_places(self) -> List[Tuple[float, float]]:
        """Return x, y (m) of every wheel: the driven ones first, in the order of `joints`."""
        half, base = self.wheels.separation / 2.0, self.wheels.base
        if self.drive == OMNIDIRECTIONAL:
            return [(x, y) for x in (base / 2.0, -base / 2.0) for y in (half, -half)]
        driven = [(0.0, half), (0.0, -half)]
        return driven + [(base, half), (base, -half)] if self.drive == CAR else driven

    def heights(self) -> np.ndarray:
        """Return the heights (m) above the ground at which to test whether the robot fits, shape (H,)."""
        highest = 0.95 * self.height
        return np.linspace(LOWEST_LOOK, highest, 1 + math.ceil((highest - LOWEST_LOOK) / STEP_BETWEEN_LOOKS))

    def solids(self, base: Frame, colours: Mapping[str, Tuple[float, float, float, float]]) -> List[Body]:
        """Return its visible solids: the parts of the body and the wheels.

        Args:
            base: Pose of base_link in the world.
            colours: Colours (RGBA) of "body", its first part, and "wheel", all others.
        """
        shown = [
            Body(self.name, part.shape, base.compose(part.frame), colour=colours["wheel" if index else "body"])
            for index, part in enumerate(self.body)
        ]
        tyre = Cylinder(self.wheels.radius, self.wheels.width)
        for x, y in self.wheel_places():
            hub = Frame.of(x, y, self.axle_height).compose(AXLE)
            shown.append(Body(self.name, tyre, base.compose(hub), colour=colours["wheel"]))
        return shown


def box_inertia(parts: Tuple[Part, ...]) -> Tuple[float, float, float]:
    """Return the moments of inertia (kg m^2) of a solid box with the parts' bounding box and total mass."""
    points = np.concatenate([part.frame.transform_points(part.shape.triangles().reshape(-1, 3)) for part in parts])
    x, y, z = np.ptp(points, axis=0)
    share = sum(part.mass for part in parts) / 12.0
    return share * (y * y + z * z), share * (x * x + z * z), share * (x * x + y * y)


def seen_from_above(parts: Tuple[Part, ...], wheels: Wheels, places: List[Tuple[float, float]]) -> np.ndarray:
    """Return the convex outline of body and wheels, shape (K, 2) in metres, counter-clockwise.

    Args:
        parts: The solids of the body.
        wheels, places: Dimensions of the wheels, and x, y (m) of each.
    """
    points = [part.frame.transform_points(part.shape.triangles().reshape(-1, 3))[:, :2] for part in parts]
    tyre = Box((2.0 * wheels.radius, wheels.width, 1.0)).triangles().reshape(-1, 3)[:, :2]
    return convex_hull(np.concatenate(points + [tyre + place for place in places]))
