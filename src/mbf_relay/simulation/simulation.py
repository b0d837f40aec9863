"""The simulation of a robot in a world: physics, sensors, commands and faults, step by step."""

from __future__ import annotations

import functools
import math
from typing import Any, Optional, Tuple, Union

import numpy as np

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.simulation.base import Base
from mbf_relay.simulation.contacts import Contact
from mbf_relay.simulation.drive import Odometer, Odometry
from mbf_relay.simulation.drivetrain import DRIVETRAINS
from mbf_relay.simulation.faults import NO_FAULTS
from mbf_relay.simulation.faulty_odometry import FaultyOdometry
from mbf_relay.simulation.four_wheels import MecanumOdometer
from mbf_relay.simulation.imu import Imu
from mbf_relay.simulation.lidar import Lidar
from mbf_relay.simulation.observations import NOTHING, JointReading, Observations
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.physics import Physics
from mbf_relay.simulation.robot import OMNIDIRECTIONAL, RobotModel
from mbf_relay.simulation.robot_file import load_robot
from mbf_relay.simulation.scene import Scene
from mbf_relay.simulation.world import World


class Simulation:
    """A robot in a world.

    Equal seeds give equal runs, bit by bit: each sensor has a random generator of its own, and the physics is
    deterministic. Time advances only by `step` and `advance`.

    Attributes:
        world: The world.
        parameters: Parameters of robot, sensors and physics.
        robot: The robot's geometry and masses.
        scene: The bodies of the world; obstacles are added there.
        base: The robot's body in the physics.
        lidar: Its lidar.
        faults: The faults in force (Faults); assign to change them.
    """

    def __init__(
        self, world: World, parameters: SimulationParameters, seed: int, gui: bool = False,
        robot: Optional[RobotModel] = None,
    ) -> None:
        """Build the world and place the robot at its start.

        Args:
            world: The world.
            parameters: Parameters of robot, sensors and physics.
            seed: Seed of the sensors' errors.
            gui: Open PyBullet's window.
            robot: The robot; the one that the parameters name where None.

        Raises:
            ValueError: The robot would intersect a body at the start, or there is no such robot.
            OSError: There is no display for the window.
        """
        self.world, self.parameters, self.faults = world, parameters, NO_FAULTS
        self._start_time = parameters.start_time
        self.physics = Physics(parameters.physics_rate, parameters.solver_iterations, gui)
        self.robot = robot = robot or load_robot(parameters.robot)
        self.scene = Scene(self.physics, world, robot)
        self._require_room(world.start, f"the start of world '{world.name}'")
        self.base = Base(self.physics, parameters, robot, world.start)
        self.physics.show(world.start, self.base.body)
        self._drivetrain = DRIVETRAINS[robot.drive](self.base, parameters, robot)
        scan, odom, imu = (np.random.Generator(np.random.PCG64(s)) for s in np.random.SeedSequence(seed).spawn(3))
        self._faulty_odometry = FaultyOdometry()
        self.lidar = Lidar(self.scene, parameters, robot.scan_in_base, scan)
        odometer = MecanumOdometer if robot.drive == OMNIDIRECTIONAL else Odometer
        self._odometer: Union[Odometer, MecanumOdometer] = odometer(
            robot.wheels, parameters.odom_noise, parameters.odom_bias, odom
        )
        self._imu = Imu(parameters, robot.imu_in_base, imu)
        self._scan_steps, self._odom_steps, self._imu_steps, self._joint_steps = (
            parameters.steps_between(name) for name in ("scan_rate", "odom_rate", "imu_rate", "joint_state_rate")
        )
        periods = self._scan_steps, self._odom_steps, self._imu_steps, self._joint_steps
        self._reading_steps = functools.reduce(math.gcd, periods)  # period of the steps at which any sensor may be due
        self._steps = self._first_step = self._pose_read = 0
        self._pose = self.base.pose()  # at the step `_pose_read`
        self._odom_angles = self._joint_angles = self._drivetrain.wheel_angles()

    @property
    def now(self) -> float:
        """Simulated time (s), above zero from the start."""
        return self._start_time + self._steps / self.parameters.physics_rate

    @property
    def true_pose(self) -> Pose2D:
        """True pose of base_footprint in the world."""
        if self._pose_read != self._steps:
            self._pose, self._pose_read = self.base.pose(), self._steps
        return self._pose

    @property
    def true_velocity(self) -> Twist2D:
        """True velocity of base_footprint in its own axes."""
        return self.base.body_velocity()

    @property
    def odometry_pose(self) -> Pose2D:
        """Pose of base_footprint in odom at the last odometry reading, without faults."""
        return self._odometer.pose

    def set_command(self, velocity: Twist2D) -> None:
        """Take a velocity command; it holds until the next one or for `cmd_vel_timeout`.

        Raises:
            ValueError: It is not finite; the one in force stays.
        """
        if not velocity.is_finite():
            raise ValueError(f"velocity command {tuple(velocity)} is not finite; it is ignored")
        self._drivetrain.command(velocity, self.faults.command_delay)

    def set_pose(self, pose: Pose2D) -> None:
        """Move the robot to a pose of base_footprint in the world, at rest; odometry does not change.

        Raises:
            ValueError: The pose is not finite, or the robot would intersect a body there; the robot is not moved.
        """
        self._require_room(pose, "a pose to set the robot down at")
        self._set_down(pose)

    def reset(self) -> None:
        """Reset robot, bodies and odometry to the start; clock and random generators go on."""
        self.scene.reset()
        self._set_down(self.world.start)
        self._odometer.restart()
        self._faulty_odometry = FaultyOdometry()  # drops delayed readings of before
        self._odom_angles = self._drivetrain.wheel_angles()
        self._first_step = self._steps

    def set_time(self, now: float) -> None:
        """Set the clock (s), as to follow another simulator's; nothing else changes."""
        self._start_time = now - self._steps / self.parameters.physics_rate
        self._faulty_odometry = FaultyOdometry()  # drops delayed readings with stamps of the old time

    def step(self) -> Observations:
        """Advance by one physics step and return the readings of the sensors that are due."""
        return self.advance(1)[1]

    def advance(self, most: int) -> Tuple[int, Observations]:
        """Advance to the next step with a sensor reading or a contact, by `most` physics steps at most.

        Returns:
            Number of steps taken, and the observations of the last one.
        """
        parameters, scene, base = self.parameters, self.scene, self.base
        slip = 1.0 - (1.0 - parameters.wheel_slip) * (1.0 - self.faults.slip)
        restless = scene.restless
        for count in range(1, most + 1):
            self._drivetrain.advance(slip, restless)
            self._steps += 1
            if restless:
                scene.advance((self._steps - self._first_step) / parameters.physics_rate)
            self.physics.step()
            if parameters.scan_skew and self._scan_steps:
                self.lidar.sweep(base.frame(), self._steps)
            contacts = scene.contacts_of(base.body)
            if contacts or self._due(self._reading_steps):
                return count, self._read(contacts)
        return most, NOTHING

    def close(self) -> None:
        """Free the physics client."""
        self.physics.close()

    def __enter__(self) -> Simulation:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()

    def _set_down(self, pose: Pose2D) -> None:
        self.base.place(pose)
        self._drivetrain.halt()  # after `place`: some drivetrains compute wheel angles from the body's motion
        self._pose = self.base.pose()
        self._imu.reset()
        if self.parameters.scan_skew:
            self.lidar.restart(self.base.frame())

    def _require_room(self, pose: Pose2D, what: str) -> None:
        if not pose.is_finite():
            raise ValueError(f"{what}, {tuple(pose)}, is not finite")
        name = self.scene.obstruction_at(pose)
        if name is not None:
            raise ValueError(
                f"{what}, ({pose.x:.3f}, {pose.y:.3f}, {pose.theta:.3f}), lies in '{name}'; choose a free place"
            )

    def _due(self, steps: int) -> bool:
        return steps > 0 and self._steps % steps == 0

    def _read(self, contacts: Tuple[Contact, ...]) -> Observations:
        """Return the readings due at this step."""
        if not self._due(self._reading_steps):
            return Observations(contacts=contacts) if contacts else NOTHING
        scan, odom, imu, joints = map(
            self._due, (self._scan_steps, self._odom_steps, self._imu_steps, self._joint_steps))
        now = self.now
        angles = self._drivetrain.wheel_angles() if odom or joints else self._odom_angles
        return Observations(
            self.lidar.scan(self.base.frame(), now, self.faults) if scan else None,
            self._read_odometry(angles, now) if odom else None,
            self._imu.read(self.base.motion(), now) if imu else None,
            self._read_joints(angles, now) if joints else None,
            contacts,
        )

    def _read_odometry(self, angles: Tuple[float, ...], now: float) -> Optional[Odometry]:
        turned = tuple(angle - before for angle, before in zip(angles, self._odom_angles))
        self._odom_angles = angles
        self._odometer.advance(turned, self._odom_steps / self.parameters.physics_rate)
        return self._faulty_odometry.newest(self._odometer.reading(now), now, self.faults)

    def _read_joints(self, angles: Tuple[float, ...], now: float) -> JointReading:
        rate = self.parameters.physics_rate / self._joint_steps
        speeds = tuple((angle - before) * rate for angle, before in zip(angles, self._joint_angles))
        self._joint_angles = angles
        still = self.robot.still_joints
        zeros = (0.0,) * len(still)
        return JointReading(now, angles + zeros, speeds + zeros, self.robot.joints + still)
