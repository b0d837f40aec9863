#!/usr/bin/env python3
"""A node named move_base_flex with nothing but its controllers: they drive a robot on paper to and fro for ever."""

import os
import sys

import rospy

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
from kinematics import PaperRobot, costmap_round, discs, path_through  # noqa: E402

from mbf_relay.control import CONTROLLERS  # noqa: E402
from mbf_relay.control.controller import Controller  # noqa: E402
from mbf_relay.control.state import ControlState  # noqa: E402
from mbf_relay.geometry import IDENTITY, Pose2D  # noqa: E402
from mbf_relay.navigation.registry import Registry  # noqa: E402
from mbf_relay.navigation.worker import InlineWorker  # noqa: E402
from mbf_relay.outcomes import ControlError  # noqa: E402
from mbf_relay.ros.common.parameters import read_namespace  # noqa: E402
from mbf_relay.ros.server.controller_topics import serve_controllers  # noqa: E402

PERIOD = 0.1
POSTS = discs((1.0, 0.4, 0.05), (1.0, -0.4, 0.05))
WAYS = (path_through((0, 0), (2, 0)), path_through((2, 0), (0, 0)))


def main() -> None:
    """Drive until ROS goes down."""
    rospy.init_node("move_base_flex")
    controllers = Registry("controllers", read_namespace("~"), Controller, CONTROLLERS, InlineWorker(), "local")
    serve_controllers(controllers)
    controller, robot, way = controllers.plugin("DWAPlannerROS"), PaperRobot(Pose2D(0.0, 0.0, 0.0)), 0
    controller.set_path(WAYS[0], True)
    rate = rospy.Rate(1.0 / PERIOD)
    while not rospy.is_shutdown():
        state = ControlState(
            rospy.get_time(), robot.pose, robot.velocity, costmap_round(robot.pose, POSTS), IDENTITY, PERIOD)
        if controller.is_goal_reached(state):
            way = 1 - way
            controller.set_path(WAYS[way], True)
        try:
            robot.move(controller.compute_velocity(state), PERIOD)
        except ControlError as error:
            rospy.logwarn_throttle(1.0, "%s", error)
        try:
            rate.sleep()
        except rospy.ROSInterruptException:
            return


if __name__ == "__main__":
    main()
