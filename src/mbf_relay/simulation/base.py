"""The burger's body in the physics: hull, two driven wheels, a caster that glides."""

from __future__ import annotations

import math
from typing import NamedTuple, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.simulation import burger
from mbf_relay.simulation.bullet import pybullet
from mbf_relay.simulation.frames import Frame
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.physics import FIXED, GROUND, IDENTITY_QUATERNION, LOOSE, ROBOT, ROLLING, Physics

WHEELS = (0, 1)
RIM_CLEARANCE = 0.003  # m between the ground and the wheels' part of the hull, which only meets obstacles
CASTER = 2
AXLE = (-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5))
"""Turns a joint's axis from z to y."""

SERVO_GAINS, VELOCITY_GAINS = (0.1, 0.1), (1.0, 1.0)
"""Share of the error in angle and in speed that the motors take away in one step."""


class Motion(NamedTuple):
    """How base_link is turned and moves.

    Attributes:
        orientation: In the world, quaternion (x, y, z, w).
        velocity: In its own axes (m/s).
        turn_rate: In its own axes (rad/s).
        up: The world's upward direction in its own axes.
    """

    orientation: Tuple[float, float, float, float]
    velocity: Tuple[float, float, float]
    turn_rate: Tuple[float, float, float]
    up: Tuple[float, float, float]


class Base:
    """The robot's body in one physics client."""

    def __init__(self, physics: Physics, parameters: SimulationParameters, pose: Pose2D) -> None:
        self._physics = physics
        self._client = physics.client
        self._torque = [parameters.wheel_torque] * 2
        self._center_of_mass = _center_of_mass()
        self._center = tuple(self._center_of_mass.tolist())
        self.body = self._create(Frame.from_pose(pose, burger.BASE_HEIGHT))
        physics.filter(self.body, ROBOT, GROUND | FIXED | LOOSE)
        for wheel in WHEELS:  # the balls that roll are wider than the wheels, which are part of the hull
            pybullet.setCollisionFilterGroupMask(self.body, wheel, ROLLING, GROUND, physicsClientId=self._client)
        self._set_dynamics(parameters.wheel_friction)
        self.turn_wheels(0.0, 0.0, 0.0, 0.0)

    def _create(self, frame: Frame) -> int:
        wheel = pybullet.createCollisionShape(
            pybullet.GEOM_SPHERE, radius=burger.WHEEL_RADIUS, physicsClientId=self._client
        )
        caster = pybullet.createCollisionShape(
            pybullet.GEOM_SPHERE, radius=burger.CASTER_RADIUS, physicsClientId=self._client
        )
        half_track = burger.WHEEL_SEPARATION / 2.0
        rim = burger.WHEEL_RADIUS - RIM_CLEARANCE
        hull = pybullet.createCollisionShapeArray(
            shapeTypes=[pybullet.GEOM_BOX] + [pybullet.GEOM_CYLINDER] * 3,
            halfExtents=[[side / 2.0 for side in burger.BODY_SIZE]] + [[0.0, 0.0, 0.0]] * 3,
            radii=[0.0, burger.LIDAR_RADIUS, rim, rim],
            lengths=[0.0, burger.LIDAR_HEIGHT, burger.WHEEL_WIDTH, burger.WHEEL_WIDTH],
            collisionFramePositions=[
                burger.BODY_CENTER, burger.LIDAR_CENTER, (0.0, half_track, burger.WHEEL_HEIGHT),
                (0.0, -half_track, burger.WHEEL_HEIGHT),
            ],
            collisionFrameOrientations=[IDENTITY_QUATERNION] * 2 + [AXLE] * 2, physicsClientId=self._client,
        )
        return pybullet.createMultiBody(
            burger.BODY_MASS + burger.LIDAR_MASS, hull, -1, frame.position.tolist(), frame.quaternion(),
            baseInertialFramePosition=self._center_of_mass.tolist(),
            linkMasses=[burger.WHEEL_MASS, burger.WHEEL_MASS, burger.CASTER_MASS],
            linkCollisionShapeIndices=[wheel, wheel, caster], linkVisualShapeIndices=[-1] * 3,
            linkPositions=[
                (0.0, half_track, burger.WHEEL_HEIGHT), (0.0, -half_track, burger.WHEEL_HEIGHT),
                (burger.CASTER_CENTER[0], 0.0, burger.CASTER_RADIUS - burger.BASE_HEIGHT),
            ],
            linkOrientations=[AXLE, AXLE, IDENTITY_QUATERNION],
            linkInertialFramePositions=[(0.0, 0.0, 0.0)] * 3, linkInertialFrameOrientations=[IDENTITY_QUATERNION] * 3,
            linkParentIndices=[0] * 3,
            linkJointTypes=[pybullet.JOINT_REVOLUTE, pybullet.JOINT_REVOLUTE, pybullet.JOINT_FIXED],
            linkJointAxis=[(0.0, 0.0, 1.0)] * 3, physicsClientId=self._client,
        )

    def _set_dynamics(self, friction: float) -> None:
        change = dict(physicsClientId=self._client)
        pybullet.changeDynamics(
            self.body, -1, linearDamping=0.0, angularDamping=0.0, jointDamping=0.0,
            localInertiaDiagonal=burger.BODY_INERTIA, lateralFriction=0.5, **change,
        )
        for wheel in WHEELS:
            pybullet.changeDynamics(
                self.body, wheel, lateralFriction=friction, rollingFriction=0.0, spinningFriction=0.0, jointDamping=0.0, **change
            )
        # With friction the caster would push the robot off its course.
        pybullet.changeDynamics(self.body, CASTER, lateralFriction=0.0, **change)

    def turn_wheels(self, left: float, right: float, left_speed: float, right_speed: float) -> None:
        """Let the motors follow angles (rad) and speeds (rad/s), as far as their torque goes.

        Held to speeds alone, the wheels would creep: the solver leaves a small error in each step, always the same way.
        """
        pybullet.setJointMotorControlArray(
            self.body, WHEELS, pybullet.POSITION_CONTROL, targetPositions=(left, right),
            targetVelocities=(left_speed, right_speed), positionGains=SERVO_GAINS, velocityGains=VELOCITY_GAINS,
            forces=self._torque, physicsClientId=self._client,
        )

    def park(self) -> None:
        """Let the body sleep until `wake`: at rest the solver's remainders would push it about, a millimetre a minute."""
        pybullet.changeDynamics(
            self.body, -1, activationState=pybullet.ACTIVATION_STATE_ENABLE_SLEEPING | pybullet.ACTIVATION_STATE_SLEEP,
            physicsClientId=self._client
        )

    def wake(self) -> None:
        """Let the body move again."""
        pybullet.changeDynamics(
            self.body, -1, activationState=pybullet.ACTIVATION_STATE_DISABLE_SLEEPING | pybullet.ACTIVATION_STATE_WAKE_UP,
            physicsClientId=self._client
        )

    def wheel_angles(self) -> Tuple[float, float]:
        """Return how far (rad) the wheels have turned, left and right."""
        left, right = pybullet.getJointStates(self.body, WHEELS, physicsClientId=self._client)
        return left[0], right[0]

    def frame(self) -> Frame:
        """Return where base_link is in the world."""
        frame = self._physics.frame_of(self.body)
        return Frame(frame.position - frame.rotation @ self._center_of_mass, frame.rotation)

    def pose(self) -> Pose2D:
        """Return where base_footprint is in the world."""
        return self.frame().flat()

    def motion(self) -> Motion:
        """Return how base_link is turned and how it moves, in its own axes.

        Written out in plain numbers: it is asked for at the rates of the fastest sensors, and numpy is slow on threes.
        """
        quaternion = pybullet.getBasePositionAndOrientation(self.body, physicsClientId=self._client)[1]
        (vx, vy, vz), (wx, wy, wz) = pybullet.getBaseVelocity(self.body, physicsClientId=self._client)
        r = pybullet.getMatrixFromQuaternion(quaternion)
        turning = (r[0] * wx + r[3] * wy + r[6] * wz, r[1] * wx + r[4] * wy + r[7] * wz, r[2] * wx + r[5] * wy + r[8] * wz)
        moving = (r[0] * vx + r[3] * vy + r[6] * vz, r[1] * vx + r[4] * vy + r[7] * vz, r[2] * vx + r[5] * vy + r[8] * vz)
        (ux, uy, uz), (x, y, z) = turning, self._center
        # The speed of the centre of mass less what the turning adds to it.
        moving = (moving[0] - (uy * z - uz * y), moving[1] - (uz * x - ux * z), moving[2] - (ux * y - uy * x))
        return Motion(quaternion, moving, turning, (r[6], r[7], r[8]))

    def body_velocity(self) -> Twist2D:
        """Return the velocity of base_footprint in the body's own axes."""
        motion = self.motion()
        return Twist2D(motion.velocity[0], motion.velocity[1], motion.turn_rate[2])

    def place(self, pose: Pose2D) -> None:
        """Set the robot down elsewhere, at rest."""
        frame = Frame.from_pose(pose, burger.BASE_HEIGHT)
        self._physics.place(self.body, Frame(frame.transform_points(self._center_of_mass), frame.rotation))
        for wheel in WHEELS:
            angle = pybullet.getJointState(self.body, wheel, physicsClientId=self._client)[0]
            pybullet.resetJointState(self.body, wheel, angle, 0.0, physicsClientId=self._client)


def _center_of_mass() -> np.ndarray:
    """Return the centre of mass of hull and lidar in base_link, shape (3,) in metres."""
    masses = np.array([burger.BODY_MASS, burger.LIDAR_MASS])
    return masses @ np.array([burger.BODY_CENTER, burger.LIDAR_CENTER]) / masses.sum()
