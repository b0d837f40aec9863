"""The fake_localization node: amcl's topics and transform, made from the robot's true pose as given by a simulator."""

from __future__ import annotations

import math
import time
from typing import Optional

import rospy
from geometry_msgs.msg import PoseArray, PoseWithCovarianceStamped
from nav_msgs.msg import Odometry

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.fake_localization import FakeLocalization, FakeLocalizationParameters
from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common import diagnostics, parameters
from mbf_relay.ros.common.checks import InvalidMessage, check_frame_is
from mbf_relay.ros.common.conversions import header, pose_from_message, pose_to_message
from mbf_relay.ros.common.message_queue import MessageQueue
from mbf_relay.ros.common.node import spare_what_stays
from mbf_relay.ros.common.transforms import TransformPublisher, Transforms

TOPIC = "base_pose_ground_truth"
LATE = 2.0
"""Seconds without a true pose after which the diagnostics call that an error."""
SILENCE = 15.0
"""Wall seconds without a true pose that are worth a warning, and from one warning to the next."""


class FakeLocalizationNode:
    """Publishes the pose and map -> odom for each true pose, once odometry's transform of the same time is there.

    Without true poses map -> odom is not repeated, so that it gets too old and the robot stops.

    Threads: callbacks store true poses in the queue, and the newest initial pose; the main thread does the rest.
    """

    def __init__(self, values: FakeLocalizationParameters) -> None:
        parameters.warn_of_tf_prefix(values.base_frame_id)
        self._values, self._localization = values, FakeLocalization(values)
        self._frames = values.odom_frame_id, values.base_frame_id
        self._queue = MessageQueue()
        self._transforms = Transforms(changed=self._queue.look_again)
        self._transform_publisher = TransformPublisher()
        self._pose_publisher = rospy.Publisher("amcl_pose", PoseWithCovarianceStamped, queue_size=2, latch=True)
        self._cloud_publisher = rospy.Publisher("particlecloud", PoseArray, queue_size=2, latch=True)
        self._initial_pose: Optional[Pose2D] = None  # applied with the next true pose
        self._sent, self._told_at = rospy.Time(0), time.monotonic()
        rospy.Subscriber("initialpose", PoseWithCovarianceStamped, self._take_initial_pose, queue_size=1)
        rospy.Subscriber(TOPIC, Odometry, self._take_truth, queue_size=10, tcp_nodelay=True)
        diagnostics.Diagnostics().add("true pose", self._report)

    def run(self) -> None:
        """Work until shutdown."""
        while not rospy.is_shutdown():
            for message in self._queue.take(self._is_ready, timeout=0.1):
                self._tell(message)
            if time.monotonic() - self._told_at > SILENCE:
                rospy.logwarn_throttle(SILENCE, self._trouble())

    def _take_truth(self, message: Odometry) -> None:
        message.header.frame_id = ""  # whatever world it is in
        self._queue.offer(message, rospy.get_time())

    def _take_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        try:
            check_frame_is(self._values.global_frame_id, message.header.frame_id)
            self._initial_pose = pose_from_message(message.pose.pose)
        except InvalidMessage as error:
            rospy.logwarn("initial pose refused: %s", error)

    def _is_ready(self, message: Odometry) -> bool:
        return self._transforms.can_transform(*self._frames, message.header.stamp.to_sec())

    def _tell(self, message: Odometry) -> None:
        """Publish where the robot is by its true pose, and map -> odom by that and odometry of the same time."""
        values, stamp = self._values, message.header.stamp
        if stamp == self._sent:
            return  # tf refuses two transforms of one stamp
        try:
            truth = pose_from_message(message.pose.pose)
            odom_pose = self._transforms.lookup(*self._frames, stamp.to_sec())
        except (InvalidMessage, TransformError) as error:
            rospy.logwarn_throttle(SILENCE, f"true pose ignored: {error}")
            return
        initial, self._initial_pose = self._initial_pose, None
        if initial is not None:
            self._localization.set_pose(initial, truth)
            rospy.loginfo("starting at x %.3f, y %.3f, yaw %.3f", *initial)
        pose, self._sent, self._told_at = self._localization.on_map(truth), stamp, time.monotonic()
        self._transform_publisher.send(
            values.global_frame_id, values.odom_frame_id, pose.compose(odom_pose.inverse()),
            stamp + rospy.Duration.from_sec(values.transform_tolerance))
        told = PoseWithCovarianceStamped(header=header(values.global_frame_id, stamp))
        told.pose.pose = pose_to_message(pose)
        self._pose_publisher.publish(told)
        self._cloud_publisher.publish(PoseArray(told.header, [told.pose.pose]))

    def _trouble(self) -> str:
        """Return why no pose is published."""
        waiting, topic = self._queue.oldest(), rospy.resolve_name(TOPIC)
        if waiting is None:
            return f"no true pose comes on {topic}"
        try:
            self._transforms.lookup(*self._frames, waiting.header.stamp.to_sec())
        except TransformError as error:
            return f"true poses on {topic} wait: {error}"
        return f"true poses on {topic} wait for transforms that have just come"

    def _report(self) -> diagnostics.Report:
        age = (rospy.get_rostime() - self._sent).to_sec() if self._sent else math.inf
        if not age <= LATE:
            return diagnostics.ERROR, self._trouble(), {"age of the last true pose [s]": f"{age:.2f}"}
        return diagnostics.OK, "true poses are told", {"age of the last true pose [s]": f"{age:.2f}"}


def main() -> None:
    """Tell where the robot is until the node ends."""
    node = FakeLocalizationNode(parameters.load(FakeLocalizationParameters))
    rospy.loginfo("fake_localization is ready; it takes true poses on %s", rospy.resolve_name(TOPIC))
    spare_what_stays()
    node.run()
