"""The `simulator` node: a robot in a world, on the topics a real one has, and the graph's clock."""

from __future__ import annotations

import contextlib
import os
import queue
import threading
from typing import Any, Callable, List, Optional

import numpy as np
import rospkg
import rospy
from geometry_msgs.msg import PoseStamped, Twist
from std_srvs.srv import Empty, EmptyResponse, Trigger, TriggerResponse
from visualization_msgs.msg import MarkerArray

from mbf_relay.geometry import STOP, Pose2D
from mbf_relay.ros.common import diagnostics, parameters, reconfigure
from mbf_relay.ros.common.checks import InvalidMessage, check_frame_is
from mbf_relay.ros.common.conversions import pose_from_message, twist_from_message
from mbf_relay.ros.common.node import spare_what_stays
from mbf_relay.ros.simulator.command_synchronizer import CommandSynchronizer
from mbf_relay.ros.simulator.footprints import drivers, too_small_footprints
from mbf_relay.ros.simulator.neighbours import ClockFollower, Neighbours
from mbf_relay.ros.simulator.obstacles import WORLD, Obstacles
from mbf_relay.ros.simulator.pacing import FactorMeter, RealTimePacer
from mbf_relay.ros.simulator.topics import SimulatorTopics
from mbf_relay.simulation.description import lidar_elsewhere
from mbf_relay.simulation.faults import Faults
from mbf_relay.simulation.node_parameters import SimulatorParameters
from mbf_relay.simulation.parameters import steps_between
from mbf_relay.simulation.simulation import Simulation
from mbf_relay.simulation.world import World
from mbf_relay.simulation.worlds import load_world

SLOW = 0.9
"""Share of the requested real time factor below which the simulation is too slow."""
SLOW_REPORTS = 5
"""Number of diagnostic reports (one per wall second) in a row that must be too slow for a warning."""
SERVICE_PATIENCE = 30.0
"""Wall seconds that a service waits for the simulation's thread."""


class Simulator:
    """Runs the simulation, its services and what comes in on topics.

    One thread owns the simulation. Callbacks and services put requests into a queue, which this thread empties between
    two steps; it never waits on ROS time, since it publishes that. It is not the main thread: rospy shuts down within
    the signal handler there, which must not interrupt a publisher.
    """

    def __init__(self, settings: SimulatorParameters, world: World) -> None:
        self._settings = settings
        self.simulation = Simulation(world, settings, settings.seed, settings.gui)
        self._clock_steps = steps_between("clock_rate", settings.clock_rate, settings.physics_rate)
        self._scan_steps = steps_between("scan_rate", settings.scan_rate, settings.physics_rate)
        self._requests: queue.Queue[Callable[[], None]] = queue.Queue()
        self._commands = CommandSynchronizer(settings.command_patience)
        self._paused = False
        self._failure: Optional[Exception] = None
        self._steps = 0
        self._pacer = (
            ClockFollower(lambda: self.simulation.now, self._set_time)
            if settings.follow_clock
            else RealTimePacer(settings.real_time_factor)
        )
        self._meter = FactorMeter(self.simulation.now)
        self._slow_reports = 0
        self._drivers_known = False
        self._topics = SimulatorTopics(settings)
        self._obstacles = Obstacles(self.simulation, settings.world_frame)
        self._listen()

    def _listen(self) -> None:
        from mbf_relay.cfg import SimulatorFaultsConfig

        rospy.Subscriber("cmd_vel", Twist, self._take_command, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber("~set_pose", PoseStamped, self._take_pose, queue_size=10)
        rospy.Subscriber("~set_obstacles", MarkerArray, self._take_obstacles)  # each counts, however many come at once
        robot = self.simulation.robot
        size = (float(np.ptp(robot.footprint, axis=0).max()), robot.height)  # neighbours are taken for robots like it
        Neighbours(self._settings.neighbours.split(), size, self._take_obstacles)
        rospy.Service("~reset", Empty, self._serve_reset)
        rospy.Service("~pause", Empty, lambda _: self._serve_pause(True))
        rospy.Service("~unpause", Empty, lambda _: self._serve_pause(False))
        rospy.Service("~step", Trigger, self._serve_step)
        rospy.Service("~take_pictures", Trigger, self._serve_pictures)
        faults = parameters.load(Faults, "~faults", (reconfigure.RESTORE_DEFAULTS,))
        self._set_faults(faults)
        reconfigure.serve(SimulatorFaultsConfig, faults, self._set_faults, "faults")
        diagnostics.Diagnostics().add("simulation", self._report)

    def run(self) -> None:
        """Step in a thread until ROS is shut down, then close the simulation; call from the main thread."""
        thread = threading.Thread(target=self._run, name="simulation", daemon=True)
        thread.start()
        while thread.is_alive():
            thread.join(0.2)
        self.simulation.close()
        if self._failure is not None:
            raise self._failure

    def _run(self) -> None:
        try:
            self._loop()
        except rospy.ROSException:
            pass  # published while ROS shut down
        except Exception as error:  # raised again by `run`
            self._failure = error

    def _loop(self) -> None:
        period = self._clock_steps / self._settings.physics_rate
        self._topics.publish_clock(self.simulation.now)
        while not rospy.is_shutdown():
            self._do_requests()
            if self._paused:
                self._rest()
                continue
            self._wait_for_answer()
            self._advance()
            while not self._pacer.pace(period) and not rospy.is_shutdown():
                self._do_requests()

    def _set_time(self, now: float) -> None:
        """Set simulated time (s), and shift the obstacles' lifetimes."""
        self._obstacles.shift(now - self.simulation.now)
        self.simulation.set_time(now)

    def _wait_for_answer(self) -> None:
        """Wait for the velocity command that answers the last scan, if the next one is made in this period."""
        if not self._scan_steps or self._steps % self._scan_steps + self._clock_steps < self._scan_steps:
            return
        if not self._commands.wait_for_answer(lambda: rospy.is_shutdown() or not self._requests.empty()):
            rospy.logwarn_throttle(
                10.0,
                f"no velocity command answered the last scan within {self._settings.command_patience} s; the "
                "simulation goes on",
            )

    def _advance(self) -> None:
        """Step through one period of the clock and publish what comes of it."""
        command = self._commands.take()
        if command is not None:
            self.simulation.set_command(command)
        self._obstacles.expire()
        for step in range(self._clock_steps):
            seen = self.simulation.step()
            self._steps += 1
            if step == self._clock_steps - 1:
                self._topics.publish_clock(self.simulation.now)
            self._topics.publish(self.simulation, seen, self._steps)
            if seen.scan is not None:
                self._commands.scan_made()

    def _take_command(self, message: Twist) -> None:
        try:
            self._commands.put(twist_from_message(message))
        except InvalidMessage as error:
            self._commands.put(STOP)  # whoever sends invalid velocities must not drive on by the last valid one
            rospy.logwarn_throttle(1.0, f"cmd_vel refused, and the robot stops: {error}")

    def _take_pose(self, message: PoseStamped) -> None:
        try:
            check_frame_is(self._settings.world_frame, message.header.frame_id)
            pose = pose_from_message(message.pose)
            if max(abs(pose.x), abs(pose.y)) > WORLD:
                raise InvalidMessage(
                    f"position ({pose.x}, {pose.y}); it must be within {WORLD:g} m of the world's middle"
                )
        except InvalidMessage as error:
            rospy.logwarn("refused to set the robot to a pose: %s", error)
            return
        self._requests.put(lambda: self._set_pose(pose))

    def _set_pose(self, pose: Pose2D) -> None:
        try:
            self.simulation.set_pose(pose)
        except ValueError as error:
            rospy.logwarn("%s", error)

    def _take_obstacles(self, message: MarkerArray) -> None:
        self._requests.put(lambda: self._obstacles.take(message))

    def _set_faults(self, faults: Faults) -> None:
        def apply() -> None:
            self.simulation.faults = faults

        self._requests.put(apply)

    def _serve_reset(self, _request: object) -> EmptyResponse:
        def reset() -> None:
            self._commands.take()  # what came before is for the drive that ends here
            self.simulation.reset()
            self._obstacles.forget()

        self._ask(reset)
        return EmptyResponse()

    def _serve_pause(self, paused: bool) -> EmptyResponse:
        def apply() -> None:
            self._paused = paused
            self._pacer.restart()

        self._ask(apply)
        return EmptyResponse()

    def _serve_step(self, _request: object) -> TriggerResponse:
        def step() -> bool:
            if self._paused:
                self._advance()
            return self._paused

        if not self._ask(step):
            return TriggerResponse(False, "the simulation is running; call pause first")
        return TriggerResponse(True, f"time is {self.simulation.now:.6f} s")

    def _serve_pictures(self, _request: object) -> TriggerResponse:
        from mbf_relay.simulation.pictures import save_pictures

        folder = self._settings.picture_folder or rospkg.get_log_dir()
        try:
            paths = self._ask(lambda: save_pictures(self.simulation, folder))
        except OSError as error:
            return TriggerResponse(False, f"the pictures cannot be written: {error}")
        return TriggerResponse(True, os.pathsep.join(paths))

    def _ask(self, request: Callable[[], Any]) -> Any:
        """Run a request in the simulation's thread; return its result, or raise its ValueError or OSError."""
        done = threading.Event()
        answers: List[Any] = []
        errors: List[Exception] = []

        def do() -> None:
            try:
                answers.append(request())
            except (ValueError, OSError) as error:
                errors.append(error)
            finally:
                done.set()

        self._requests.put(do)
        if not done.wait(SERVICE_PATIENCE):
            raise rospy.ServiceException(f"the simulation did not answer within {SERVICE_PATIENCE:.0f} s")
        if errors:
            raise errors[0]
        return answers[0]

    def _do_requests(self) -> None:
        while True:
            try:
                request = self._requests.get_nowait()
            except queue.Empty:
                self._obstacles.tell()
                return
            request()

    def _rest(self) -> None:
        """Wait for a request while paused; the time is published for new subscribers."""
        self._topics.publish_clock(self.simulation.now)
        with contextlib.suppress(queue.Empty):
            self._requests.get(timeout=0.2)()

    def _report(self) -> diagnostics.Report:
        if self._commands.heard and not self._drivers_known:  # who drives it has read its parameters by now
            self._drivers_known = True
            self._look_at_footprints()
        factor, asked = self._meter.measure(self.simulation.now), self._settings.real_time_factor
        values = {
            "real time factor": "unknown" if factor is None else f"{factor:.2f}",
            "real time factor asked for": f"{asked:g}" if asked else "as fast as it goes",
            "simulated time [s]": f"{self.simulation.now:.2f}", "contacts": self._topics.contacts,
            "commands heard": self._commands.heard, "waits for commands given up": self._commands.given_up,
            "world": self.simulation.world.name, "seed": self._settings.seed,
        }
        slow = not self._paused and factor is not None and factor < SLOW * asked
        self._slow_reports = self._slow_reports + 1 if slow else 0
        if self._slow_reports == SLOW_REPORTS:
            rospy.logwarn(
                "the simulation runs at %.2f of real time instead of %g: the machine is too slow for it", factor, asked
            )
        if slow:
            return diagnostics.WARN, f"runs at {factor:.2f} of real time instead of {asked:g}", values
        return diagnostics.OK, "paused" if self._paused else "running", values

    def _look_at_footprints(self) -> None:
        """Warn of nodes whose local costmap has a footprint smaller than the robot."""
        nodes = drivers(rospy.get_param_names(), rospy.get_namespace())  # get_param("/") tells what rospy has cached
        values = {node: parameters.read_namespace(node) for node in sorted(nodes)}
        for line in too_small_footprints(values, self.simulation.robot):
            rospy.logwarn("%s", line)


def main() -> None:
    """Run the node until ROS is shut down."""
    settings = parameters.load(SimulatorParameters, known_elsewhere=("faults",))
    world = settings.placed(load_world(settings.world, settings.world_name))
    for warning in world.warnings:
        rospy.logwarn("world '%s': %s", world.name, warning)
    simulator = Simulator(settings, world)
    for warning in simulator.simulation.robot.warnings:
        rospy.logwarn("robot '%s': %s", simulator.simulation.robot.name, warning)
    description = rospy.get_param(rospy.search_param("robot_description") or "robot_description", "")
    warning = lidar_elsewhere(str(description), settings.base_frame, settings.scan_frame, simulator.simulation.robot)
    if warning:
        rospy.logwarn("%s", warning)
    rospy.loginfo(
        "simulating world '%s' with seed %d at %s", world.name, settings.seed,
        f"{settings.real_time_factor:g} x real time" if settings.real_time_factor else "full speed",
    )
    spare_what_stays()
    simulator.run()
