"""The simulation: a world, a burger in it, and the readings of its sensors, step by step."""

from __future__ import annotations

import math
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.geometry import STOP, Pose2D, Twist2D
from mbf_relay.scan import LaserScan
from mbf_relay.simulation.base import Base
from mbf_relay.simulation.drive import Odometer, Odometry, approach, limit_command, wheel_speeds
from mbf_relay.simulation import burger
from mbf_relay.simulation.contacts import Contact, Contacts
from mbf_relay.simulation.imu import Imu, ImuReading
from mbf_relay.simulation.lidar import Lidar
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.physics import FIXED, LIDAR, LOOSE, RAYS, ROBOT, Physics
from mbf_relay.simulation.world import World


class JointReading(NamedTuple):
    """The wheels, left and right: time (s), angles (rad), speeds (rad/s)."""

    stamp: float
    positions: Tuple[float, float]
    velocities: Tuple[float, float]


class Observations(NamedTuple):
    """What a step gave; None where a sensor was not due."""

    scan: Optional[LaserScan] = None
    odometry: Optional[Odometry] = None
    imu: Optional[ImuReading] = None
    joints: Optional[JointReading] = None
    contacts: Tuple[Contact, ...] = ()


NOTHING = Observations()
STANDSTILL = (0.0, 0.0)
PARK_AFTER = 0.5
"""Time (s) after which a standing robot's body sleeps."""


class Simulation:
    """A burger in a world.

    One seed gives one run to the last bit: each sensor draws from a generator of its own, and the physics is
    deterministic. Time goes on by `step` alone.
    """

    def __init__(self, world: World, parameters: SimulationParameters, seed: int, gui: bool = False) -> None:
        """Build the world and set the robot down at its start.

        Args:
            world: The place.
            parameters: Of robot, sensors and time.
            seed: For all chance in the run.
            gui: Open PyBullet's window.
        """
        self.world, self.parameters = world, parameters
        self.physics = Physics(parameters.physics_rate, parameters.solver_iterations, gui)
        self._names: Dict[int, str] = {}
        self._add_world(world)
        self.base = Base(self.physics, parameters, world.start)
        generators = [np.random.Generator(np.random.PCG64(s)) for s in np.random.SeedSequence(seed).spawn(3)]
        self._lidar = Lidar(self.physics, parameters, generators[0])
        self._odometer = Odometer(parameters.odom_noise, parameters.odom_bias, generators[1])
        self._imu = Imu(parameters, generators[2])
        self._scan_steps, self._odom_steps, self._imu_steps, self._joint_steps = (
            parameters.steps_between(name) for name in ("scan_rate", "odom_rate", "imu_rate", "joint_state_rate")
        )
        self._rim_change = parameters.wheel_acceleration / parameters.physics_rate / burger.WHEEL_RADIUS
        self._steps = 0
        self._command, self._command_step = STOP, 0
        self._timeout_steps = math.ceil(parameters.cmd_vel_timeout * parameters.physics_rate) or None
        self._target = self._speeds = STANDSTILL
        self._idle_steps, self._park_steps = 0, math.ceil(PARK_AFTER * parameters.physics_rate)
        self._angles = self._odom_angles = self._joint_angles = self._wanted_angles = self.base.wheel_angles()

    def _add_world(self, world: World) -> None:
        triangles, owners = world.fixed_triangles()
        self.physics.add_fixed(triangles, FIXED, ROBOT | LOOSE)
        self.physics.add_fixed(_seen_by_level_rays(triangles), LIDAR, RAYS)
        self._contacts = Contacts(triangles, owners, [body.name for body in world.bodies])
        for body in world.bodies:
            if body.mass > 0.0:
                self._names[self.physics.add_loose(body.shape, body.frame, body.mass)] = body.name
        self._movers = [(self.physics.add_loose(m.body.shape, m.body.frame, 0.0), m) for m in world.movers]
        self._names.update({number: mover.body.name for number, mover in self._movers})

    @property
    def _pushed(self) -> bool:
        """Tell whether something in the world moves by itself and may push the robot."""
        return bool(self._names)

    @property
    def now(self) -> float:
        """Simulated time (s), above zero from the start."""
        return self.parameters.start_time + self._steps / self.parameters.physics_rate

    @property
    def true_pose(self) -> Pose2D:
        """Where base_footprint really is in the world."""
        return self.base.pose()

    @property
    def true_velocity(self) -> Twist2D:
        """How the robot really moves, in its own axes."""
        return self.base.body_velocity()

    def set_command(self, velocity: Twist2D) -> None:
        """Take a velocity command; it holds until the next one or for `cmd_vel_timeout`.

        Raises:
            ValueError: It is not finite; the one in force stays.
        """
        if not velocity.is_finite():
            raise ValueError(f"velocity command {tuple(velocity)} is not finite; it is ignored")
        self._command, self._command_step = limit_command(velocity, self.parameters), self._steps
        self._target = wheel_speeds(self._command)

    def set_pose(self, pose: Pose2D) -> None:
        """Set the robot down elsewhere, at rest; its odometry does not notice.

        Raises:
            ValueError: The pose is not finite.
        """
        if not pose.is_finite():
            raise ValueError(f"pose {tuple(pose)} is not finite; the robot stays where it is")
        self.base.place(pose)
        self._imu.reset()
        self._speeds = STANDSTILL
        self._wake()

    def reset(self) -> None:
        """Bring everything back to where it was at first; the clock and the chance in the sensors go on."""
        self.set_pose(self.world.start)
        self._odometer.restart()
        self._command = STOP
        self._target = STANDSTILL

    def step(self) -> Observations:
        """Advance by one physics step and return what the sensors that were due then read."""
        if self._timeout_steps is not None and self._steps - self._command_step >= self._timeout_steps:
            self._target = STANDSTILL
        self._drive()
        for body, mover in self._movers:
            self._place_mover(body, mover)
        self.physics.step()
        self._steps += 1
        contacts = self._contacts.find(self.physics, self.base.body, self._names)
        return self._read(contacts)

    def close(self) -> None:
        """Free the physics."""
        self.physics.close()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def _wake(self) -> None:
        if self._idle_steps >= self._park_steps:
            self.base.wake()
        self._idle_steps = 0

    def _drive(self) -> None:
        """Bring the wheels nearer to the speeds wanted, or let a robot that has stood for a while sleep."""
        if self._speeds == self._target == STANDSTILL and not self._pushed:
            self._idle_steps += 1
            if self._idle_steps == self._park_steps:
                self.base.park()
        else:
            self._wake()
            self._speeds = tuple(approach(s, t, self._rim_change) for s, t in zip(self._speeds, self._target))
        if self._idle_steps < self._park_steps:
            self._turn_wheels()

    def _turn_wheels(self) -> None:
        period = 1.0 / self.parameters.physics_rate
        (left, right), (left_speed, right_speed) = self._wanted_angles, self._speeds
        self._wanted_angles = (left + left_speed * period, right + right_speed * period)
        self.base.turn_wheels(*self._wanted_angles, left_speed, right_speed)

    def _place_mover(self, body: int, mover: Any) -> None:
        from mbf_relay.simulation.frames import Frame

        pose = mover.pose_at(self.now - self.parameters.start_time)
        frame = mover.body.frame
        self.physics.place(body, Frame.from_pose(pose, float(frame.position[2])))

    def _read(self, contacts: Tuple[Contact, ...]) -> Observations:
        """Return the readings due at this step."""
        due = [
            bool(period) and self._steps % period == 0
            for period in (self._scan_steps, self._odom_steps, self._imu_steps, self._joint_steps)
        ]
        if not any(due):
            return NOTHING if not contacts else Observations(contacts=contacts)
        scan, odom, imu, joints = due
        now = self.now
        if odom or joints:
            self._angles = self.base.wheel_angles()
        return Observations(
            self._lidar.scan(self.base.frame(), now) if scan else None,
            self._read_odometry(now) if odom else None,
            self._imu.read(self.base, now) if imu else None,
            self._read_joints(now) if joints else None,
            contacts,
        )

    def _read_odometry(self, now: float) -> Odometry:
        left, right = (angle - last for angle, last in zip(self._angles, self._odom_angles))
        self._odom_angles = self._angles
        self._odometer.advance(left, right, self._odom_steps / self.parameters.physics_rate)
        return self._odometer.reading(now)

    def _read_joints(self, now: float) -> JointReading:
        rate = self.parameters.physics_rate / self._joint_steps
        left, right = ((angle - last) * rate for angle, last in zip(self._angles, self._joint_angles))
        self._joint_angles = self._angles
        return JointReading(now, self._angles, (left, right))


LEVEL = 0.999999


def _seen_by_level_rays(triangles: np.ndarray) -> np.ndarray:
    """Return the triangles, shape (N, 3, 3), without those that lie flat or far above and below the lidar."""
    if not len(triangles):
        return triangles
    height = burger.BASE_HEIGHT + burger.SCAN_IN_BASE.position[2]
    heights = triangles[:, :, 2]
    near = (heights.min(axis=1) < height + 0.5) & (heights.max(axis=1) > height - 0.5)
    triangles = triangles[near]
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    sizes = np.linalg.norm(normals, axis=1)
    return triangles[np.abs(normals[:, 2]) < LEVEL * np.maximum(sizes, 1e-15)]
