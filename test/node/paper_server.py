#!/usr/bin/env python3
"""The real server over scripted plugins and an empty costmap, with a robot that goes where it is told: for races.

Parameters beside the server's: ~plan_time (s) a plan takes.
"""

import os
import sys
import threading

import rospy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "unit", "navigation"))
import scripted  # noqa: E402
from geometry_msgs.msg import Twist, TransformStamped  # noqa: E402
from nav_msgs.msg import Odometry  # noqa: E402

from mbf_relay.geometry import IDENTITY, Pose2D  # noqa: E402
from mbf_relay.planning.path import Path  # noqa: E402
from mbf_relay.ros.conversions import header, pose_to_message, transform_to_message, twist_from_message  # noqa: E402
from mbf_relay.ros.move_base_flex import MoveBaseFlex  # noqa: E402
from mbf_relay.ros.parameters import read_namespace  # noqa: E402
from mbf_relay.ros.transforms import TransformPublisher, Transforms  # noqa: E402

PERIOD = 0.03


class WheelsOfPaper:
    """Does what cmd_vel says, and tells so in odometry and tf."""

    def __init__(self) -> None:
        self.pose, self.command = IDENTITY, Twist()
        self._transforms = TransformPublisher()
        self._odometry = rospy.Publisher("odom", Odometry, queue_size=1, tcp_nodelay=True)
        rospy.Subscriber("cmd_vel", Twist, self._on_command, queue_size=1, tcp_nodelay=True)
        threading.Thread(target=self._loop, daemon=True).start()

    def _on_command(self, message: Twist) -> None:
        self.command = message

    def _loop(self) -> None:
        pause = threading.Event()
        while not rospy.is_shutdown():
            velocity = twist_from_message(self.command)
            self.pose = self.pose.compose(Pose2D(*(PERIOD * part for part in velocity)))
            stamp = rospy.get_rostime()
            self._transforms.send_messages([
                TransformStamped(header("map", stamp), "odom", transform_to_message(IDENTITY)),
                TransformStamped(header("odom", stamp), "base", transform_to_message(self.pose)),
            ])
            odometry = Odometry(header=header("odom", stamp), child_frame_id="base")
            odometry.pose.pose, odometry.twist.twist = pose_to_message(self.pose), self.command
            self._odometry.publish(odometry)
            pause.wait(PERIOD)


def main() -> None:
    """Serve until ROS goes down."""
    rospy.init_node("move_base_flex")
    script, pause = scripted.SCRIPT, threading.Event()

    def plan(start: Pose2D, goal: Pose2D) -> Path:
        pause.wait(rospy.get_param("~plan_time", 0.005))
        return scripted.line(start, goal)

    def reached(state) -> bool:
        path = script.paths[-1][0]
        return state.pose.distance_to(path.goal) < 0.05

    def steer(state):
        goal = script.paths[-1][0].goal
        away = goal.relative_to(state.pose)
        scale = 0.2 / max(0.2, (away.x ** 2 + away.y ** 2) ** 0.5)
        return (away.x * scale, away.y * scale, 0.0)

    script.plan, script.reached, script.velocity = plan, reached, steer
    script.recovery = lambda context: (scripted.FORWARD for _ in range(20))
    wheels = WheelsOfPaper()
    costmaps = {"global": scripted.PaperCostmap("map"), "local": scripted.PaperCostmap("odom")}
    server = MoveBaseFlex({**scripted.config(), **read_namespace("~")}, costmaps, Transforms(), {})
    server.start()
    rospy.spin()
    del wheels


main()
