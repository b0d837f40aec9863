"""What the simulator publishes."""

from __future__ import annotations

from typing import List

import rospy
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3
from nav_msgs.msg import Odometry as OdometryMessage
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from sensor_msgs.msg import LaserScan as LaserScanMessage
from visualization_msgs.msg import MarkerArray

from mbf_relay.ros.common.conversions import header, transform_to_message
from mbf_relay.ros.common.transforms import TransformPublisher
from mbf_relay.ros.simulator import messages
from mbf_relay.simulation.node_parameters import SimulatorParameters
from mbf_relay.simulation.observations import Observations
from mbf_relay.simulation.parameters import steps_between
from mbf_relay.simulation.robot import RobotModel
from mbf_relay.simulation.simulation import Simulation
from mbf_relay.touching import Touched

CONTACT_PERIOD = 0.1
"""Simulated seconds between two messages about a contact that lasts."""


class SimulatorTopics:
    """Publishers of readings, truth, contacts and the clock; used by the simulation's thread alone.

    Attributes:
        contacts: How often the robot has touched something.
    """

    def __init__(self, settings: SimulatorParameters) -> None:
        self._settings = settings
        self._truth_steps = steps_between("truth_rate", settings.truth_rate, settings.physics_rate)
        self.contacts = 0
        self._touched = Touched()
        self._told = 0.0
        fast = dict(queue_size=10, tcp_nodelay=True)
        if not settings.follow_clock:
            self._clock = rospy.Publisher("/clock", Clock, **fast)
        self._scan = rospy.Publisher("scan", LaserScanMessage, **fast)
        self._odom = rospy.Publisher("odom", OdometryMessage, **fast)
        self._imu = rospy.Publisher("imu", Imu, **fast)
        self._joints = rospy.Publisher("joint_states", JointState, **fast)
        self._truth = rospy.Publisher("ground_truth", OdometryMessage, **fast)
        self._contacts = rospy.Publisher("contacts", MarkerArray, queue_size=100)
        self._tf = TransformPublisher()

    def _below_base(self, robot: RobotModel, stamp: float) -> List[TransformStamped]:
        """Return where a robot's description hangs on its base, if that has no place in it; with the base's prefix."""
        if not robot.root:
            return []
        base = self._settings.base_frame
        place = Transform(Vector3(*robot.root_in_base.position), Quaternion(*robot.root_in_base.quaternion()))
        return [TransformStamped(header(base, stamp), "".join(base.rpartition("/")[:2]) + robot.root, place)]

    def publish_clock(self, now: float) -> None:
        """Publish the time (s), unless somebody else does."""
        if not self._settings.follow_clock:
            self._clock.publish(Clock(rospy.Time.from_sec(now)))

    def publish(self, simulation: Simulation, seen: Observations, steps: int) -> None:
        """Publish what one step gave; `steps` counts them. Of what nobody listens to no message is made."""
        settings = self._settings
        if seen.odometry is not None:
            if settings.publish_odom_tf:
                top = header(settings.odom_frame, seen.odometry.stamp)
                base = TransformStamped(top, settings.base_frame, transform_to_message(seen.odometry.pose))
                self._tf.send_messages([base, *self._below_base(simulation.robot, seen.odometry.stamp)])
            self._odom.publish(messages.odometry_to_message(seen.odometry, settings))
        if seen.joints is not None and _is_heard(self._joints):
            self._joints.publish(messages.joints_to_message(seen.joints))
        if seen.imu is not None and _is_heard(self._imu):
            self._imu.publish(messages.imu_to_message(seen.imu, settings))
        if seen.scan is not None:
            self._scan.publish(messages.scan_to_message(seen.scan, settings))
        if self._truth_steps and steps % self._truth_steps == 0 and _is_heard(self._truth):
            self._truth.publish(
                messages.odometry_message(
                    simulation.true_pose,
                    simulation.true_velocity,
                    simulation.now,
                    settings.world_frame,
                    settings.base_frame,
                )
            )
        if seen.contacts:
            self._tell_contacts(seen, simulation.now)

    def _tell_contacts(self, seen: Observations, now: float) -> None:
        """Publish contacts: at once where a body is touched anew, at times while the touch lasts."""
        fresh = [contact for contact in seen.contacts if self._touched.note_contact(contact.name, now)]
        for contact in fresh:
            self.contacts += 1
            rospy.logwarn(
                "the robot touches '%s' at (%.2f, %.2f)", contact.name, contact.position[0], contact.position[1]
            )
        if fresh or not 0.0 <= now - self._told < CONTACT_PERIOD:  # the clock may be set back
            self._told = now
            self._contacts.publish(messages.contacts_to_message(seen.contacts, now, self._settings.world_frame))


def _is_heard(publisher: rospy.Publisher) -> bool:
    """Return whether anybody listens, so that a message is worth its making."""
    return bool(publisher.get_num_connections() > 0)
