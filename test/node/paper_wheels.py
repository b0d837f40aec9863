"""A robot that does exactly what cmd_vel says, and tells so in odometry and tf; on the wall clock, without physics."""

import threading

import rospy
from geometry_msgs.msg import TransformStamped, Twist
from nav_msgs.msg import Odometry

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.ros.common.conversions import header, pose_to_message, transform_to_message, twist_from_message
from mbf_relay.ros.common.transforms import TransformPublisher

PERIOD = 0.03


class PaperWheels:
    """Publishes map -> odom -> base (or `base_frame`) and odometry until stopped.

    Attributes:
        silent: Names of what is not published for now: "odom", "tf", "localization".
    """

    def __init__(self, base_frame: str = "base") -> None:
        self.pose, self.command, self.silent = IDENTITY, Twist(), set()
        self._base_frame = base_frame
        self._transforms = TransformPublisher()
        self._odometry = rospy.Publisher("odom", Odometry, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber("cmd_vel", Twist, self._on_command, queue_size=1, tcp_nodelay=True)
        self._stopped = threading.Event()
        threading.Thread(target=self._loop, daemon=True).start()

    def stop(self) -> None:
        """Publish no more."""
        self._stopped.set()

    def _on_command(self, message: Twist) -> None:
        self.command = message

    def _loop(self) -> None:
        while not self._stopped.wait(PERIOD) and not rospy.is_shutdown():
            velocity = twist_from_message(self.command)
            self.pose = self.pose.compose(Pose2D(*(PERIOD * part for part in velocity)))
            self._publish(rospy.get_rostime())

    def _publish(self, stamp: rospy.Time) -> None:
        transforms = []
        if "localization" not in self.silent:
            transforms.append(TransformStamped(header("map", stamp), "odom", transform_to_message(IDENTITY)))
        if "tf" not in self.silent:
            transforms.append(
                TransformStamped(header("odom", stamp), self._base_frame, transform_to_message(self.pose))
            )
        try:
            self._transforms.send_messages(transforms)
            if "odom" not in self.silent:
                odometry = Odometry(header=header("odom", stamp), child_frame_id=self._base_frame)
                odometry.pose.pose, odometry.twist.twist = pose_to_message(self.pose), self.command
                self._odometry.publish(odometry)
        except rospy.ROSException:
            self._stopped.set()  # the node is going down
