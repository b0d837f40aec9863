"""The robot as ROS shows it: tf, odometry and cmd_vel."""

from __future__ import annotations

import threading
from collections import defaultdict
from typing import Any, Callable, Dict, Optional, Tuple

import rospy
from geometry_msgs.msg import Twist
from std_msgs.msg import String

from mbf_relay.geometry import IDENTITY, STOP, Pose2D, Twist2D
from mbf_relay.navigation.odometry_monitor import OdometryMonitor, TransformMonitor
from mbf_relay.navigation.robot import Robot
from mbf_relay.outcomes import StaleDataError
from mbf_relay.ros.common.conversions import transform_from_message, twist_to_message
from mbf_relay.ros.common.diagnostics import RateMeter
from mbf_relay.ros.common.odometry import OdometryInput, planar_pose
from mbf_relay.ros.common.transforms import Transforms

COMMANDS_PAUSE = 1.0
"""Time (s) without a command after which a drive is over; the rate of commands is then measured anew."""
GUARD = "velocity_guard"
"""Node that may reduce or block velocities between this server and the robot, and publishes that on its ~state."""
OBJECTS, PASSES = ("stopped", "slowed down"), "passing"
"""First words of its states while it reduces or blocks velocities, and while it passes them on."""
AGE = "pose_timeout, or the costmaps' transform_tolerance"
"""Names, for errors, of the parameters that limit the age of transforms."""


class _Wheels(rospy.SubscribeListener):
    """Sends a zero velocity to each new subscriber of `cmd_vel`, unless the robot is being driven.

    A base may still execute the last velocity of a server that died and was started again.
    """

    def __init__(self, robot: RosRobot) -> None:
        self._robot = robot

    def peer_subscribe(self, topic_name: str, topic_publish: Any, peer_publish: Callable[[Twist], None]) -> None:
        """Send zero to a new subscriber, unless another velocity was sent last."""
        if self._robot.told == STOP:
            peer_publish(twist_to_message(STOP))


class RosRobot(Robot):
    """Reads the robot's pose from tf and its velocity from odometry; sends velocities on `cmd_vel`.

    Args:
        transforms: Where frames are looked up.
        base_frame: The robot's frame.
        pose_timeout: Returns the largest age (s) of a transform.
        odom_timeout: Largest age (s) of odometry.

    Attributes:
        commands: Measures the rate of commands.
        told: The last velocity published. It differs from `commanded` while the robot is held, and after `close`.
    """

    def __init__(
        self, transforms: Transforms, base_frame: str, pose_timeout: Callable[[], float], odom_timeout: float
    ) -> None:
        super().__init__()
        self._transforms, self._base_frame = transforms, base_frame
        self._pose_timeout, self._odom_timeout = pose_timeout, odom_timeout
        self._odometry: Optional[OdometryInput] = None
        self._poses: Dict[str, Tuple[float, Pose2D]] = {}  # last pose by frame, with its time (s)
        self._velocity_at: Optional[float] = None  # stamp (s) of the last odometry used, None without any
        self._tf_monitors: Dict[str, TransformMonitor] = defaultdict(TransformMonitor)
        self._monitor = OdometryMonitor()
        self.commands = RateMeter(pause=COMMANDS_PAUSE)
        self.told = STOP
        self._publisher = rospy.Publisher("cmd_vel", Twist, _Wheels(self), queue_size=1, tcp_nodelay=True)
        self._closing = threading.Lock()  # held while a velocity is sent, so that none follows the last zero
        self._closed = self._blocked = self._held = False
        self._objection = ""
        rospy.Subscriber(f"{GUARD}/state", String, self._hear_guard, queue_size=1)

    def listen(self, odom_topic: str) -> None:
        """Subscribe to a topic of odometry.

        Without a name, or where nobody has ever published there, the last command is taken for the robot's velocity:
        move_base, too, drives robots without odometry.
        """
        if odom_topic:
            self._odometry = OdometryInput(odom_topic)

    def pose_in(self, frame: str) -> Pose2D:
        """Return the newest pose of the base in `frame`; raise TransformError where it is unknown or too old."""
        found = self._transforms.lookup_message(frame, self._base_frame, max_age=self._pose_timeout(), named=AGE)
        pose = transform_from_message(found.transform)
        self._poses[frame] = found.header.stamp.to_sec(), pose
        return pose

    def transform(self, target_frame: str, source_frame: str) -> Pose2D:
        """Return the newest transform to `target_frame`; raise TransformError where it is unknown or too old."""
        return self._transforms.lookup(target_frame, source_frame, max_age=self._pose_timeout(), named=AGE)

    def velocity(self) -> Twist2D:
        """Return the newest velocity, body frame.

        Raises:
            StaleDataError: There is none, it is too old, or odometry's poses contradict it or those of tf.
        """
        if self._odometry is None:
            return self.commanded or STOP
        topic = self._odometry.topic
        if not self._odometry.is_expected:
            rospy.logwarn_once(
                "nobody publishes odometry on %s: the last command is taken for the robot's velocity; remap odom to "
                "the robot's topic, or set ~odom_topic", topic)
            return self.commanded or STOP
        odometry, stamp, velocity = self._odometry.read(rospy.get_time(), self._odom_timeout)
        pose = planar_pose(odometry)
        trouble = self._monitor.trouble(stamp, pose, velocity)
        if trouble is not None:
            raise StaleDataError(f"{trouble} ({topic})")
        for frame, (at, seen) in list(self._poses.items()):
            trouble = self._tf_monitors[frame].trouble(at, seen, stamp, pose)
            if trouble is not None:
                raise StaleDataError(f"{trouble} ('{self._base_frame}' in '{frame}' and {topic})")
        self._velocity_at = stamp
        return velocity

    def pose_ahead(self, frame: str) -> float:
        """Return by how much (s) tf is ahead of odometry, below 0 where it lags behind: 0.0 without odometry."""
        told_at, (at, _) = self._velocity_at, self._poses.get(frame, (0.0, IDENTITY))
        if told_at is None or at == 0.0:  # a static transform has stamp 0
            return 0.0
        now: float = rospy.get_time()  # a stamp ahead of now, as of amcl's transform, counts as now
        return min(now, at) - min(now, told_at)

    @property
    def unheard(self) -> str:
        """Return a text if `cmd_vel` has no subscriber, as after the driver has ended; empty otherwise."""
        return "" if self._publisher.get_num_connections() else f"nobody listens to {self._publisher.resolved_name}"

    @property
    def held_back(self) -> str:
        """Return why velocity_guard blocked or reduced the last velocity, empty where it did not."""
        return self._objection

    def _hear_guard(self, state: String) -> None:
        if state.data.startswith(OBJECTS):
            self._objection = f"{GUARD} says '{state.data}'"
        elif state.data.startswith(PASSES):
            self._objection = ""

    def command(self, velocity: Twist2D) -> None:
        """Send a velocity; one that is not finite becomes a stop."""
        if not velocity.is_finite():
            rospy.logerr("refused to send velocity %s: it is not finite", tuple(velocity))
            velocity = STOP
        with self._closing:
            if not (self._closed or self._blocked):
                self.commanded = velocity
                self.commands.tick(rospy.get_time())
                self._publish(STOP if self._held else velocity)

    def hold(self, is_held: bool) -> None:
        """Hold the robot at zero, or send it the present command again; from any thread."""
        with self._closing:
            if is_held == self._held or self._closed:
                return
            self._held = is_held
            if self.commanded is not None and self.commanded != STOP:
                self._publish(STOP if is_held else self.commanded)

    def block(self) -> None:
        """Send a zero velocity and drop all commands until `release`; from any thread."""
        with self._closing:
            if not self._closed:
                self._blocked, self.commanded = True, STOP
                self._publish(STOP)

    def release(self) -> None:
        """Send commands again after `block`."""
        with self._closing:
            self._blocked = False

    def close(self) -> None:
        """Send a zero velocity, and nothing afterwards."""
        with self._closing:
            if not self._closed:
                self._closed = True
                self._publish(STOP)

    def _publish(self, velocity: Twist2D) -> None:
        self.told = velocity
        self.delay.tell(rospy.get_time(), velocity)
        self._publisher.publish(twist_to_message(self.steering.steered(velocity) if self.steering else velocity))
