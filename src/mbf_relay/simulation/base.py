"""The robot's body in PyBullet: a hull for collisions, and balls on which it stands.

A differential drive stands on two driven wheels (balls with friction, turned by motors) and on casters without
friction. A robot with four wheels, mecanum or steered, stands on balls without friction, and its body's velocity is set
in each step, with the tyres' grip as a limit to its change.
"""

from __future__ import annotations

import math
from typing import Any, Dict, List, NamedTuple, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.simulation.bullet import pybullet
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.physics import FIXED, GRAVITY, GROUND, IDENTITY_QUATERNION, LOOSE, ROBOT, ROLLING, Physics
from mbf_relay.simulation.robot import AXLE as WHEEL_AXLE
from mbf_relay.simulation.robot import DIFFERENTIAL, RobotModel
from mbf_relay.simulation.shapes import Box, Cylinder

WHEELS = (0, 1)
"""Links of the driven wheels, left and right."""
RIM_CLEARANCE = 0.003
"""Height (m) of the wheels' part of the hull above the ground, as balls carry the robot and this part only collides."""
AXLE = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Quaternion (x, y, z, w) that rotates a joint's axis from z to y."""
LEAST_WHEEL = 0.015
"""Least mass of a wheel as a share of the body's: under a body 1000 times as heavy the solver's iterations do not turn
wheels as fast as their motors are told, and the robot takes seconds to its speed."""
CASTER_GIVES = 0.002
"""Deflection (m) of a caster's contact spring under the robot's whole weight."""
SERVO_GAINS, VELOCITY_GAINS = (0.1, 0.1), (1.0, 1.0)
"""PyBullet's positionGains and velocityGains: share of the error in angle and speed that is corrected in one step."""


class Motion(NamedTuple):
    """How base_link is turned and moves.

    Attributes:
        orientation: In the world, quaternion (x, y, z, w).
        velocity: Linear velocity in its own axes (m/s).
        turn_rate: Angular velocity in its own axes (rad/s).
        up: Unit vector along the world's z axis, in its own axes.
    """

    orientation: Tuple[float, float, float, float]
    velocity: Tuple[float, float, float]
    turn_rate: Tuple[float, float, float]
    up: Tuple[float, float, float]


class Base:
    """The robot's body in one physics client."""

    def __init__(self, physics: Physics, parameters: SimulationParameters, robot: RobotModel, pose: Pose2D) -> None:
        """Create the body.

        Args:
            physics: The physics client.
            parameters: Parameters of motors and tyres.
            robot: The robot's geometry and masses.
            pose: Pose of base_footprint in the world.
        """
        self._physics, self._robot = physics, robot
        self._client = physics.client
        self._torque = [parameters.wheel_torque] * 2
        self._driven = WHEELS if robot.drive == DIFFERENTIAL else ()
        self._center_of_mass = _center_of_mass(robot)
        self._center = tuple(self._center_of_mass.tolist())
        self.body = self._create(Frame.from_pose(pose, robot.base_height))
        physics.filter(self.body, ROBOT, GROUND | FIXED | LOOSE)
        feet = WHEELS if self._driven else range(len(robot.wheel_places()))
        for wheel in feet:  # balls meet the ground only: they are wider than the wheels, which the hull includes
            pybullet.setCollisionFilterGroupMask(self.body, wheel, ROLLING, GROUND, physicsClientId=self._client)
        self._set_dynamics(parameters.wheel_friction)
        if self._driven:
            self.turn_wheels(0.0, 0.0, 0.0, 0.0)

    def _create(self, frame: Frame) -> int:
        """Create a multibody: the hull, and a link with a ball for each wheel and each caster; return its number."""
        robot, places = self._robot, self._robot.wheel_places()
        mass = sum(part.mass for part in robot.body)
        wheel_mass = max(robot.wheels.mass, LEAST_WHEEL * mass)
        links = [(x, y, robot.axle_height, robot.wheels.radius, wheel_mass) for x, y in places]
        links += [(c.x, c.y, c.radius - robot.base_height, c.radius, c.mass) for c in robot.casters]
        rolls = [bool(self._driven) and index < len(places) for index in range(len(links))]
        balls = [
            pybullet.createCollisionShape(pybullet.GEOM_SPHERE, radius=radius, physicsClientId=self._client)
            for *_, radius, _mass in links
        ]
        body: int = pybullet.createMultiBody(
            mass, self._hull(), -1, frame.position.tolist(), frame.quaternion(),
            baseInertialFramePosition=self._center_of_mass.tolist(),
            linkMasses=[link[4] for link in links], linkCollisionShapeIndices=balls,
            linkVisualShapeIndices=[-1] * len(links), linkPositions=[link[:3] for link in links],
            linkOrientations=[AXLE if turns else IDENTITY_QUATERNION for turns in rolls],
            linkInertialFramePositions=[(0.0, 0.0, 0.0)] * len(links),
            linkInertialFrameOrientations=[IDENTITY_QUATERNION] * len(links), linkParentIndices=[0] * len(links),
            linkJointTypes=[pybullet.JOINT_REVOLUTE if turns else pybullet.JOINT_FIXED for turns in rolls],
            linkJointAxis=[(0.0, 0.0, 1.0)] * len(links), physicsClientId=self._client,
        )
        return body

    def _hull(self) -> int:
        """Return PyBullet's number of the collision shape: the body's parts and the wheels.

        Parts that are meshes, as polygons and all bodies from URDFs are, make one convex hull with the wheels.
        """
        rim = Cylinder(self._robot.wheels.radius - RIM_CLEARANCE, self._robot.wheels.width)
        if all(isinstance(part.shape, (Box, Cylinder)) for part in self._robot.body):
            return self._hull_of_shapes(rim)
        return self._convex_hull(rim)

    def _convex_hull(self, rim: Cylinder) -> int:
        robot = self._robot
        hubs = [Frame.of(x, y, robot.axle_height).compose(WHEEL_AXLE) for x, y in robot.wheel_places()]
        solids = [(part.shape, part.frame) for part in robot.body] + [(rim, hub) for hub in hubs]
        corners = [frame.transform_points(shape.triangles().reshape(-1, 3)) for shape, frame in solids]
        hull: int = pybullet.createCollisionShape(
            pybullet.GEOM_MESH, vertices=np.unique(np.concatenate(corners), axis=0).tolist(),
            physicsClientId=self._client,
        )
        return hull

    def _hull_of_shapes(self, rim: Cylinder) -> int:
        robot = self._robot
        shapes: List[Dict[str, Any]] = []
        for part in robot.body:
            shape, place = part.shape, (part.frame.position.tolist(), part.frame.quaternion())
            if isinstance(shape, Box):
                shapes.append(dict(kind=pybullet.GEOM_BOX, half=[side / 2.0 for side in shape.size], place=place))
            elif isinstance(shape, Cylinder):
                shapes.append(dict(kind=pybullet.GEOM_CYLINDER, radius=shape.radius, length=shape.height, place=place))
        wheel = dict(kind=pybullet.GEOM_CYLINDER, radius=rim.radius, length=rim.height)
        shapes += [dict(wheel, place=((x, y, robot.axle_height), AXLE)) for x, y in robot.wheel_places()]
        hull: int = pybullet.createCollisionShapeArray(
            shapeTypes=[shape["kind"] for shape in shapes],
            halfExtents=[shape.get("half", [0.0, 0.0, 0.0]) for shape in shapes],
            radii=[shape.get("radius", 0.0) for shape in shapes],
            lengths=[shape.get("length", 0.0) for shape in shapes],
            collisionFramePositions=[shape["place"][0] for shape in shapes],
            collisionFrameOrientations=[shape["place"][1] for shape in shapes], physicsClientId=self._client,
        )
        return hull

    def _set_dynamics(self, friction: float) -> None:
        change = dict(physicsClientId=self._client)
        pybullet.changeDynamics(
            self.body, -1, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
            localInertiaDiagonal=self._robot.inertia, lateralFriction=0.5, **change,
        )
        for wheel in self._driven:
            pybullet.changeDynamics(
                self.body,
                wheel,
                lateralFriction=friction,
                rollingFriction=0.0,
                spinningFriction=0.0,
                jointDamping=0.0,
                **change,
            )
        # Casters have no friction, which would turn the robot off its course.
        for foot in range(len(self._driven), pybullet.getNumJoints(self.body, **change)):
            pybullet.changeDynamics(self.body, foot, lateralFriction=0.0, **change)
            if self._driven and len(self._robot.casters) > 1:  # with four rigid feet or more, a wheel may carry nothing
                weight = sum(part.mass for part in self._robot.body)
                stiffness = GRAVITY * weight / CASTER_GIVES
                pybullet.changeDynamics(
                    self.body, foot, contactStiffness=stiffness, contactDamping=2.0 * math.sqrt(stiffness * weight),
                    **change,
                )

    def push(self, velocity: Twist2D, grip: float, turn_grip: float) -> None:
        """Change the planar velocity of base_link towards `velocity`, by at most what the tyres' grip allows in a step.

        Args:
            velocity: Wanted velocity in the body's own axes.
            grip, turn_grip: Largest change of linear and angular velocity (m/s, rad/s).
        """
        quaternion = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=self._client)[1]
        (vx, vy, vz), (wx, wy, wz) = pybullet.getBaseVelocity(self.body, physicsClientId=self._client)
        r = pybullet.getMatrixFromQuaternion(quaternion)
        x, y, _ = self._center
        forward, aside = velocity.x - velocity.theta * y, velocity.y + velocity.theta * x  # of the centre of mass
        dx, dy = r[0] * forward + r[1] * aside - vx, r[3] * forward + r[4] * aside - vy
        share = min(1.0, grip / max(math.hypot(dx, dy), 1e-12))
        turn = min(turn_grip, max(-turn_grip, velocity.theta - wz))
        pybullet.resetBaseVelocity(
            self.body, (vx + share * dx, vy + share * dy, vz), (wx, wy, wz + turn), physicsClientId=self._client
        )

    def turn_wheels(self, left: float, right: float, left_speed: float, right_speed: float) -> None:
        """Set the motors' target angles (rad) and speeds (rad/s), which they follow as far as their torque allows.

        Controlled by speed alone the wheels would drift: the solver leaves a small error of one sign in each step.
        """
        pybullet.setJointMotorControlArray(
            self.body, WHEELS, pybullet.POSITION_CONTROL, targetPositions=(left, right),
            targetVelocities=(left_speed, right_speed), positionGains=SERVO_GAINS, velocityGains=VELOCITY_GAINS,
            forces=self._torque, physicsClientId=self._client,
        )

    def park(self) -> None:
        """Put the body to sleep until `wake`: at rest the solver's errors would move it by a millimetre a minute."""
        pybullet.changeDynamics(
            self.body, -1, activationState=pybullet.ACTIVATION_STATE_ENABLE_SLEEPING | pybullet.ACTIVATION_STATE_SLEEP,
            physicsClientId=self._client
        )

    def wake(self) -> None:
        """Activate the body again after `park`."""
        pybullet.changeDynamics(
            self.body,
            -1,
            activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING | pybullet.ACTIVATION_STATE_WAKE_UP,
            physicsClientId=self._client,
        )

    def wheel_angles(self) -> Tuple[float, float]:
        """Return the joint angles (rad) of the left and the right wheel, which are not wrapped."""
        left, right = pybullet.getJointStates(self.body, WHEELS, physicsClientId=self._client)
        return left[0], right[0]

    def frame(self) -> Frame:
        """Return the pose of base_link in the world."""
        frame = self._physics.frame_of(self.body)
        return Frame(frame.position - frame.rotation @ self._center_of_mass, frame.rotation)

    def pose(self) -> Pose2D:
        """Return the pose of base_footprint in the world."""
        return self.frame().flat()

    def motion(self) -> Motion:
        """Return orientation and velocities of base_link.

        Written out without NumPy, which is slow on vectors of three; called at the rate of the fastest sensor.
        """
        quaternion = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=self._client)[1]
        (vx, vy, vz), (wx, wy, wz) = pybullet.getBaseVelocity(self.body, physicsClientId=self._client)
        r = pybullet.getMatrixFromQuaternion(quaternion)
        turning = (
            r[0] * wx + r[3] * wy + r[6] * wz,
            r[1] * wx + r[4] * wy + r[7] * wz,
            r[2] * wx + r[5] * wy + r[8] * wz,
        )
        moving = (
            r[0] * vx + r[3] * vy + r[6] * vz,
            r[1] * vx + r[4] * vy + r[7] * vz,
            r[2] * vx + r[5] * vy + r[8] * vz,
        )
        (ux, uy, uz), (x, y, z) = turning, self._center
        # Velocity of base_link: that of the centre of mass, less turn rate x offset.
        moving = (moving[0] - (uy * z - uz * y), moving[1] - (uz * x - ux * z), moving[2] - (ux * y - uy * x))
        return Motion(quaternion, moving, turning, (r[6], r[7], r[8]))

    def body_velocity(self) -> Twist2D:
        """Return the velocity of base_footprint in the body's own axes."""
        motion = self.motion()
        return Twist2D(motion.velocity[0], motion.velocity[1], motion.turn_rate[2])

    def place(self, pose: Pose2D) -> None:
        """Move the robot to a pose of base_footprint, at rest."""
        frame = Frame.from_pose(pose, self._robot.base_height)
        self._physics.place(self.body, Frame(frame.transform_points(self._center_of_mass), frame.rotation))
        for wheel in self._driven:
            angle = pybullet.getJointState(self.body, wheel, physicsClientId=self._client)[0]
            pybullet.resetJointState(self.body, wheel, angle, 0.0, physicsClientId=self._client)


def _center_of_mass(robot: RobotModel) -> np.ndarray:
    """Return the centre of mass of the body's parts in base_link, shape (3,) in metres."""
    masses = np.array([part.mass for part in robot.body])
    center: np.ndarray = masses @ np.array([part.frame.position for part in robot.body]) / masses.sum()
    return center
