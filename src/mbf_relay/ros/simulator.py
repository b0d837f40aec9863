"""The `simulator` node: a burger in a world, on the topics a real one has, and the graph's clock.

One thread, the one that called `run`, owns the simulation. Callbacks and services leave what they want done in a queue
that this thread empties between two steps; it never waits on ROS time, which it makes.
"""

from __future__ import annotations

import queue
import threading
from typing import Callable, Dict, Optional

import rospy
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist
from nav_msgs.msg import Odometry as OdometryMessage
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from sensor_msgs.msg import LaserScan as LaserScanMessage
from std_srvs.srv import Empty, EmptyResponse, Trigger, TriggerResponse
from visualization_msgs.msg import MarkerArray

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.ros import diagnostics, parameters, simulator_messages
from mbf_relay.ros.conversions import InvalidMessage, header, pose_from_message, transform_to_message, twist_from_message
from mbf_relay.ros.pacing import FactorMeter, Pacer
from mbf_relay.ros.transforms import TransformPublisher
from mbf_relay.simulation.node_parameters import SimulatorParameters
from mbf_relay.simulation.parameters import steps_between
from mbf_relay.simulation.observations import Observations
from mbf_relay.simulation.simulation import Simulation
from mbf_relay.simulation.worlds import load_world

SLOW = 0.9
"""Share of the real time factor asked for below which it is too slow."""
CONTACT_PERIOD = 0.1
"""Simulated seconds between two messages about a contact that lasts."""
SERVICE_PATIENCE = 10.0
"""Wall seconds a service waits for the simulation to do what was asked."""


class Simulator:
    """Runs the simulation and its topics."""

    def __init__(self, settings: SimulatorParameters) -> None:
        self._settings = settings
        world = settings.placed(load_world(settings.world, settings.world_name))
        self.simulation = Simulation(world, settings, settings.seed, settings.gui)
        self._truth_steps = steps_between("truth_rate", settings.truth_rate, settings.physics_rate)
        self._clock_steps = steps_between("clock_rate", settings.clock_rate, settings.physics_rate)
        self._requests: "queue.Queue[Callable[[], None]]" = queue.Queue()
        self._command_lock = threading.Lock()
        self._command: Optional[Twist2D] = None
        self._commands_heard = 0
        self._paused = False
        self._pacer = Pacer(settings.real_time_factor)
        self._meter = FactorMeter(self.simulation.now)
        self._contacts = 0
        self._touched: Dict[str, float] = {}
        self._contact_told = 0.0
        self._steps = 0
        self._advertise()

    def _advertise(self) -> None:
        fast = dict(queue_size=10, tcp_nodelay=True)
        self._clock = rospy.Publisher("/clock", Clock, **fast)
        self._scan = rospy.Publisher("scan", LaserScanMessage, **fast)
        self._odom = rospy.Publisher("odom", OdometryMessage, **fast)
        self._imu = rospy.Publisher("imu", Imu, **fast)
        self._joints = rospy.Publisher("joint_states", JointState, **fast)
        self._truth = rospy.Publisher("ground_truth", OdometryMessage, **fast)
        self._contact_markers = rospy.Publisher("contacts", MarkerArray, queue_size=100)
        self._tf = TransformPublisher()
        rospy.Subscriber("cmd_vel", Twist, self._take_command, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber("~set_pose", PoseStamped, self._take_pose, queue_size=1)
        rospy.Service("~reset", Empty, self._serve_reset)
        rospy.Service("~pause", Empty, self._serve_pause)
        rospy.Service("~unpause", Empty, self._serve_unpause)
        rospy.Service("~step", Trigger, self._serve_step)
        self._diagnostics = diagnostics.Diagnostics()
        self._diagnostics.add("simulation", self._report)

    def run(self) -> None:
        """Step until ROS is shut down."""
        period = self._clock_steps / self._settings.physics_rate
        while not rospy.is_shutdown():
            self._do_requests()
            if self._paused:
                self._rest()
                continue
            self._advance()
            self._pacer.pace(period)

    def close(self) -> None:
        """Free the physics."""
        self.simulation.close()

    def _advance(self) -> None:
        """Step through one period of the clock and publish what comes of it."""
        with self._command_lock:
            command, self._command = self._command, None
        if command is not None:
            self.simulation.set_command(command)
        for _ in range(self._clock_steps):
            seen = self.simulation.step()
            self._steps += 1
            if self._steps % self._clock_steps == 0:
                self._clock.publish(Clock(rospy.Time.from_sec(self.simulation.now)))
            self._publish(seen)

    def _publish(self, seen: Observations) -> None:
        settings = self._settings
        if seen.odometry is not None:
            if settings.publish_odom_tf:
                self._tf.send_messages([TransformStamped(
                    header(settings.odom_frame, seen.odometry.stamp), settings.base_frame,
                    transform_to_message(seen.odometry.pose),
                )])
            self._odom.publish(simulator_messages.odometry_to_message(seen.odometry, settings))
        if seen.joints is not None:
            self._joints.publish(simulator_messages.joints_to_message(seen.joints))
        if seen.imu is not None:
            self._imu.publish(simulator_messages.imu_to_message(seen.imu, settings))
        if seen.scan is not None:
            self._scan.publish(simulator_messages.scan_to_message(seen.scan, settings))
        if self._truth_steps and self._steps % self._truth_steps == 0:
            self._truth.publish(simulator_messages.odometry_message(
                self.simulation.true_pose, self.simulation.true_velocity, self.simulation.now, settings.world_frame,
                settings.base_frame,
            ))
        if seen.contacts:
            self._tell_contacts(seen)

    def _tell_contacts(self, seen: Observations) -> None:
        """Publish contacts: at once where a body is touched anew, at times while the touch lasts."""
        now = self.simulation.now
        fresh = False
        for contact in seen.contacts:
            if now - self._touched.get(contact.name, -1.0) > CONTACT_PERIOD:
                fresh = True
                self._contacts += 1
                rospy.logwarn(
                    "contact with '%s' at (%.2f, %.2f), time %.2f s", contact.name, contact.position[0], contact.position[1], now
                )
            self._touched[contact.name] = now
        if fresh or now - self._contact_told >= CONTACT_PERIOD:
            self._contact_told = now
            self._contact_markers.publish(
                simulator_messages.contacts_to_message(seen.contacts, now, self._settings.world_frame)
            )

    def _take_command(self, message: Twist) -> None:
        try:
            command = twist_from_message(message)
        except InvalidMessage as error:
            rospy.logwarn_throttle(1.0, f"cmd_vel refused: {error}")
            return
        with self._command_lock:
            self._command = command
            self._commands_heard += 1

    def _take_pose(self, message: PoseStamped) -> None:
        frame = message.header.frame_id.lstrip("/")
        if frame not in ("", self._settings.world_frame):
            rospy.logwarn(f"pose to set the robot down at refused: frame '{frame}'; it must be '{self._settings.world_frame}'")
            return
        try:
            pose = pose_from_message(message.pose)
        except InvalidMessage as error:
            rospy.logwarn(f"pose to set the robot down at refused: {error}")
            return
        self._requests.put(lambda: self._set_pose(pose))

    def _set_pose(self, pose: Pose2D) -> None:
        try:
            self.simulation.set_pose(pose)
        except ValueError as error:
            rospy.logwarn("%s", error)

    def _serve_reset(self, _request: object) -> EmptyResponse:
        self._ask(self.simulation.reset)
        return EmptyResponse()

    def _serve_pause(self, _request: object) -> EmptyResponse:
        self._ask(lambda: self._pause(True))
        return EmptyResponse()

    def _serve_unpause(self, _request: object) -> EmptyResponse:
        self._ask(lambda: self._pause(False))
        return EmptyResponse()

    def _serve_step(self, _request: object) -> TriggerResponse:
        stepped = []
        self._ask(lambda: stepped.append(self._paused and (self._advance() or True)))
        if not stepped[0]:
            return TriggerResponse(False, "the simulation is running; call pause first")
        return TriggerResponse(True, f"time is {self.simulation.now:.6f} s")

    def _pause(self, paused: bool) -> None:
        self._paused = paused
        self._pacer.restart()

    def _ask(self, request: Callable[[], None]) -> None:
        """Have the simulation's thread do something, and wait until it is done."""
        done = threading.Event()
        errors = []

        def do() -> None:
            try:
                request()
            except ValueError as error:
                errors.append(error)
            finally:
                done.set()

        self._requests.put(do)
        if not done.wait(SERVICE_PATIENCE):
            raise rospy.ServiceException(f"the simulation did not answer within {SERVICE_PATIENCE:.0f} s")
        if errors:
            raise rospy.ServiceException(str(errors[0]))

    def _do_requests(self) -> None:
        while True:
            try:
                request = self._requests.get_nowait()
            except queue.Empty:
                return
            request()

    def _rest(self) -> None:
        """Wait, paused, for something to do; whoever joins meanwhile gets the time."""
        self._clock.publish(Clock(rospy.Time.from_sec(self.simulation.now)))
        try:
            self._requests.get(timeout=0.2)()
        except queue.Empty:
            pass

    def _report(self) -> diagnostics.Report:
        factor, asked = self._meter.look(self.simulation.now), self._settings.real_time_factor
        values = {
            "real time factor": "unknown" if factor is None else f"{factor:.2f}",
            "real time factor asked for": f"{asked:g}" if asked else "as fast as it goes",
            "simulated time [s]": f"{self.simulation.now:.2f}", "contacts": self._contacts,
            "commands heard": self._commands_heard, "world": self.simulation.world.name, "seed": self._settings.seed,
        }
        if self._paused:
            return diagnostics.OK, "paused", values
        if factor is not None and asked and factor < SLOW * asked:
            return diagnostics.WARN, f"runs at {factor:.2f} of real time, asked for {asked:g}", values
        return diagnostics.OK, "running", values


def main() -> None:
    """Run the node until ROS is shut down."""
    settings = parameters.load(SimulatorParameters)
    simulator = Simulator(settings)
    rospy.loginfo(
        "simulating world '%s' with seed %d at %s", simulator.simulation.world.name, settings.seed,
        f"{settings.real_time_factor:g} x real time" if settings.real_time_factor else "full speed",
    )
    try:
        simulator.run()
    finally:
        simulator.close()
