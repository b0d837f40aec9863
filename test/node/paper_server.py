#!/usr/bin/env python3
"""The real server over scripted plugins and an empty costmap, with a robot that goes where it is told: for races.

Parameters beside the server's: ~script/plan_time (s) a plan takes, ~script/recovery_steps a behaviour drives for.
"""

import os
import sys
import threading

import rospy

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, ".."), os.path.join(HERE, "..", "unit", "navigation")]
import scripted  # noqa: E402
from node.paper_wheels import PaperWheels  # noqa: E402

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.planning.path import Path  # noqa: E402
from mbf_relay.ros.common.parameters import read_namespace  # noqa: E402
from mbf_relay.ros.common.transforms import Transforms  # noqa: E402
from mbf_relay.ros.server.node import MoveBaseFlex  # noqa: E402


def plan(start: Pose2D, goal: Pose2D) -> Path:
    """Think for as long as the test wants."""
    threading.Event().wait(rospy.get_param("~script/plan_time", 0.005))
    return scripted.line(start, goal)


def newest_goal() -> Pose2D:
    """Where the newest path leads."""
    return scripted.SCRIPT.paths[-1][0].goal


def steer(state):
    """Go straight to the goal, slower near it."""
    away = newest_goal().relative_to(state.pose)
    scale = 0.2 / max(0.2, (away.x ** 2 + away.y ** 2) ** 0.5)
    return (away.x * scale, away.y * scale, 0.0)


def main() -> None:
    """Serve until ROS goes down."""
    rospy.init_node("move_base_flex")
    script = scripted.SCRIPT
    script.plan, script.velocity = plan, steer
    script.reached = lambda state: state.pose.distance_to(newest_goal()) < 0.05
    script.recovery = lambda context: (scripted.FORWARD for _ in range(rospy.get_param("~script/recovery_steps", 20)))
    wheels = PaperWheels()
    costmaps = {"global": scripted.PaperCostmap("map"), "local": scripted.PaperCostmap("odom")}
    server = MoveBaseFlex({**scripted.config(), **read_namespace("~")}, costmaps, Transforms(), {})
    server.start()
    rospy.spin()
    wheels.stop()


if __name__ == "__main__":
    main()
