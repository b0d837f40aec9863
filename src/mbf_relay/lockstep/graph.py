"""Simulation, localization, costmaps and navigation, connected as the nodes are by topics and tf, and stepped."""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import replace
from typing import Callable, Deque, Dict, NamedTuple, Optional, Tuple

import numpy as np

from mbf_relay.control.state import GoalTolerance
from mbf_relay.costmap.costmap import Costmap
from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.freshness import FIRST_TRIES
from mbf_relay.costmap.observation import observation_from_level_points, scan_points, unseen_points
from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.node_parameters import AmclParameters, initial_pose_from
from mbf_relay.lockstep.rate import Rate
from mbf_relay.lockstep.robot import LockstepRobot
from mbf_relay.lockstep.setup import AMCL, KNOWN, ODOMETRY, SERVER, TRUTH, Setup, faults_in, without_map
from mbf_relay.lockstep.stages import Stages, TimedWorker
from mbf_relay.lockstep.tasks import EpisodeTask
from mbf_relay.maps import OccupancyMap
from mbf_relay.navigation.goals import NavigateGoal, NavigateResult
from mbf_relay.navigation.navigator import Navigator
from mbf_relay.navigation.task import Task
from mbf_relay.outcomes import TransformError
from mbf_relay.scan import LaserScan
from mbf_relay.scan_monitor import ScanMonitor
from mbf_relay.scan_timing import ScanTiming
from mbf_relay.simulation import Simulation
from mbf_relay.simulation.contacts import Contact
from mbf_relay.simulation.parameters import SimulationParameters
from mbf_relay.simulation.robot import FOOTPRINT_FRAME


class _Updated(NamedTuple):
    """A costmap with its update rate, and the rate at which the first update is tried."""

    costmap: Costmap
    usual: Rate
    first: Rate

    @property
    def rate(self) -> Rate:
        """The rate in force."""
        return self.usual if self.costmap.updates else self.first


class StepReport(NamedTuple):
    """Result of a step: what the robot touches, and whether navigation was updated."""

    contacts: Tuple[Contact, ...]
    navigated: bool


class Graph:
    """Simulation, localization, costmaps and navigation, each at the rates of its parameters.

    Attributes:
        simulation: The world and the robot in it.
        robot: The robot's interface for navigation.
        navigator: Planners, controllers, recoveries and move_base.
        costmaps: "global" and "local".
        map_frame: Frame of goals.
        laser_in_base: Pose of the lidar in base_footprint.
        steps: Number of simulation steps so far.
    """

    def __init__(
        self, task: EpisodeTask, setup: Setup, seed: int, stages: Stages, on_command: Callable[[float, Twist2D], None]
    ) -> None:
        """Build and connect the parts.

        Args:
            task: The world.
            setup: The parameters.
            seed: Seed of all random numbers.
            stages: Sums up computing times.
            on_command: Called with the time (s) and velocity of each command.

        Raises:
            ValueError: A parameter is wrong.
        """
        self._stages = stages
        server = setup.settings[SERVER] if setup.map == KNOWN else without_map(setup.settings[SERVER], task)
        amcl = AmclParameters.from_mapping(setup.settings["amcl"])
        needs_map = setup.map == KNOWN or setup.localization == AMCL
        self.map_frame, self._odom_frame = amcl.global_frame_id, amcl.odom_frame_id
        self.simulation = Simulation(task.world, _simulation_parameters(setup), seed, robot=setup.robot)
        self.simulation.faults = faults_in(setup.settings)
        self.laser_in_base = self.simulation.robot.scan_in_base.flat()
        self._scan_height = self.simulation.robot.scan_height
        known = task.occupancy(setup.map_resolution, self._scan_height) if needs_map else None
        try:
            self._on_command = on_command
            self.robot = LockstepRobot(self._command, self.map_frame, self._odom_frame, FOOTPRINT_FRAME)
            self._localizer: Optional[Localizer] = None
            self._locate(task, setup, amcl, known, seed)
            self._build_costmaps(known if setup.map == KNOWN else None, server)
            if setup.localization == ODOMETRY:
                self._share_scans()
            self.navigator = Navigator(server, self.robot, self.costmaps, TimedWorker(stages))
            limits = self.navigator.parameters
            oldest = limits.oldest_pose(self.costmaps.values())
            self.robot.limit_ages(lambda: self.now, oldest, limits.odom_timeout)
            self._controller = self.navigator.controllers.plugin(self.navigator.controllers.choose(setup.controller))
            self.navigator.planners.choose(setup.planner)  # raises now, not at the first goal, if it does not exist
        except BaseException:
            self.close()
            raise
        self.steps = 0
        self._scans: Deque[LaserScan] = deque()
        self._timing = ScanTiming() if self.simulation.parameters.scan_skew else None  # else beams have one time
        self._next_update = self._updated_at = -math.inf

    def _locate(
        self, task: EpisodeTask, setup: Setup, amcl: AmclParameters, known: Optional[OccupancyMap], seed: int
    ) -> None:
        """Set up the source of map → odom."""
        self._follows_truth = setup.localization == TRUTH
        if setup.localization == ODOMETRY:
            self.robot.map_from_odom = task.world.start  # odometry begins at zero
        elif known is not None and setup.localization == AMCL:
            self._localizer = Localizer(amcl, known, np.random.default_rng(seed))
            pose, covariance, _ = initial_pose_from(setup.settings["amcl"])
            self._localizer.set_initial_pose(task.initial_pose or pose, covariance)

    def _build_costmaps(self, known: Optional[OccupancyMap], server: dict) -> None:
        self.costmaps = {
            name: build_costmap(f"{name}_costmap", server.get(f"{name}_costmap", {}), server)
            for name in ("global", "local")
        }
        if known is not None:
            for costmap in self.costmaps.values():
                costmap.set_map(known)
        self._monitors = {  # one for each largest_gap that an observation source allows, all of the one lidar
            source.largest_gap: ScanMonitor(source.largest_gap)
            for costmap in self.costmaps.values() for source in costmap.sources.values()
        }
        self._updated = []
        for costmap in self.costmaps.values():
            frequency = costmap.parameters.update_frequency
            usual, first = (Rate(each, self.time_step) for each in (frequency, max(frequency, FIRST_TRIES)))
            self._updated.append(_Updated(costmap, usual, first if frequency < FIRST_TRIES else usual))

    def _share_scans(self) -> None:
        """Let the global costmap's layers reuse what the local ones find in a scan, where both frames do not move.

        See `Layer.share`.
        """
        local, known = self.costmaps["local"], self.costmaps["global"]
        if {local.frame, known.frame} <= self.robot.fixed_frames:
            for layer, other in itertools.product(known.layers, local.layers):
                layer.share(other, self.robot.transform(known.frame, local.frame))

    @property
    def goal_tolerance(self) -> Optional[GoalTolerance]:
        """Goal tolerance of the controller in use; None where it does not declare one."""
        return self._controller.goal_tolerance

    @property
    def time_step(self) -> float:
        """Seconds of one step."""
        return 1.0 / self.simulation.parameters.physics_rate

    @property
    def now(self) -> float:
        """Simulated time (s)."""
        return self.simulation.now

    @property
    def elapsed(self) -> float:
        """Simulated seconds since the start."""
        return self.steps * self.time_step

    def waits_for(self) -> Optional[str]:
        """Return what is still missing before a goal can be sent; None where nothing is."""
        try:
            self.robot.pose_in(self.map_frame)
        except TransformError as error:
            return str(error)
        for costmap in self.costmaps.values():
            try:
                self.robot.pose_in(costmap.frame)
            except TransformError as error:
                return f"{costmap.name}: {error}"
            reason = costmap.stale_reason(self.now)
            if reason is not None:
                return reason
        return None

    def navigate(self, goal: NavigateGoal) -> Task[NavigateResult]:
        """Send a goal, which preempts a running one; return its task."""
        self._next_update = -math.inf
        return self.navigator.move_base(goal)

    def step(self, most: int = 1) -> StepReport:
        """Advance the simulation to the next step at which something is due, by `most` steps at most, and do that."""
        most = min(most, self._steps_to_navigation(), *(each.rate.steps_left(self.steps) for each in self._updated))
        with self._stages.stage("simulation"):
            steps, observations = self.simulation.advance(most)
        self.steps += steps
        if observations.odometry is not None:
            odometry = observations.odometry
            self.robot.add_odometry(odometry.stamp, odometry.pose, odometry.velocity)
            if self._follows_truth:
                self.robot.map_from_odom = self.simulation.true_pose.compose(odometry.pose.inverse())
        if observations.scan is not None:
            self._scans.append(observations.scan)
        while self._scans and self._scans[0].stamp <= self.robot.odometry_stamp:
            self._take_scan(self._scans.popleft())
        for each in self._updated:
            if each.rate.take_turn(self.steps):
                self._update(each.costmap)
        return StepReport(observations.contacts, self._navigate())

    def _steps_to_navigation(self) -> int:
        """Return the number of steps until navigation is due, rounded down; 1 at least."""
        steps = (self._next_update - 1e-9 - self.now) * self.simulation.parameters.physics_rate
        return int(min(1e9, max(1.0, steps)))

    def _navigate(self) -> bool:
        """Update navigation where it is due; return whether it was.

        Plugins run inline, so that only its own updates change when it is due next.
        """
        now = self.now
        if self._updated_at <= now < self._next_update - 1e-9:  # time may be set back
            return False
        self._updated_at = now
        with self._stages.stage("navigation"):
            self.navigator.update(now)
        self._next_update = self.navigator.due
        return True

    def close(self) -> None:
        """Free the physics engine."""
        self.simulation.close()

    def _take_scan(self, scan: LaserScan) -> None:
        """Update localization with a scan, then the costmaps' observations, from the robot's pose at the scan's time.
        """
        raw = scan
        if self._timing is not None:
            self._timing.take(raw, self._laser_at)
            scan = self._timing.corrected(raw, self._laser_at)
        try:
            odom_pose = self.robot.odometry_at(scan.stamp)
        except TransformError:
            return  # no odometry is kept of that time
        if self._localizer is not None:
            with self._stages.stage("localization"):
                self._localizer.process(odom_pose, scan, self.laser_in_base)
                self.robot.map_from_odom = self._localizer.map_from_odom
        with self._stages.stage("costmaps"):
            self._observe(scan, raw, odom_pose)

    def _observe(self, scan: LaserScan, raw: LaserScan, odom_pose: Pose2D) -> None:
        """Give a scan to the costmaps, or what is wrong with it.

        Args:
            scan, raw: The scan, and as it was before its timing was corrected.
            odom_pose: Pose of the base in odometry's frame at the scan's time.
        """
        points: Dict[bool, Tuple[np.ndarray, np.ndarray]] = {}  # the scan's points, by inf_is_valid
        unseen_at = unseen_points(scan)
        forward, laser_in_odom = -self.laser_in_base.theta, odom_pose.compose(self.laser_in_base)
        troubles = {gap: each.trouble(raw, forward, laser_in_odom) for gap, each in self._monitors.items()}
        for costmap in reversed(tuple(self.costmaps.values())):  # the local one first, see _share_scans
            try:
                odom_in_costmap = self.robot.transform(costmap.frame, self._odom_frame)
            except TransformError:
                continue
            base = odom_in_costmap.compose(odom_pose)
            laser = base.compose(self.laser_in_base)
            for name, source in costmap.sources.items():
                if source.data_type != "LaserScan":
                    continue
                trouble = troubles[source.largest_gap]
                if trouble is not None:
                    costmap.refuse(name, trouble)
                    continue
                if source.inf_is_valid not in points:
                    points[source.inf_is_valid] = scan_points(scan, source.inf_is_valid)
                seen = observation_from_level_points(
                    *points[source.inf_is_valid], laser, scan.stamp, self._scan_height)
                unseen = None if unseen_at is None else laser.transform_points(unseen_at)
                costmap.observe(name, replace(seen, base=base, unseen=unseen), self.now)

    def _laser_at(self, time: float) -> Pose2D:
        return self.robot.odometry_at(time).compose(self.laser_in_base)

    def _update(self, costmap: Costmap) -> None:
        with self._stages.stage("costmaps"):
            try:
                pose = self.robot.pose_in(costmap.frame)
                for layer in costmap.layers:
                    frame = layer.map_frame or (self.map_frame if layer.maps_floor else costmap.frame)
                    if frame != costmap.frame:
                        costmap.set_map_from_costmap(self.robot.transform(frame, costmap.frame), layer.name)
            except TransformError:
                return
            costmap.update(self.now, pose)

    def _command(self, velocity: Twist2D) -> None:
        self._on_command(self.now, velocity)
        self.simulation.set_command(velocity)


def _simulation_parameters(setup: Setup) -> SimulationParameters:
    """Return the simulator's parameters with sensors switched off that nothing reads here.

    That changes no other sensor's noise, as each has a random generator of its own.
    """
    values = setup.settings["simulator"]
    if setup.robot is not None:  # sent with the setup to a worker that may not have the robot's file
        own = {name: value for name, value in values.items() if name != "robot"}
        values = {**SimulationParameters.known(setup.robot.settings), **SimulationParameters.known(own)}
    parameters = SimulationParameters.from_mapping(values)
    return parameters.replace(imu_rate=0.0, joint_state_rate=0.0)
