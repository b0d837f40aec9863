#!/usr/bin/env python3
"""The real server with real costmaps over scripted plugins, and a robot that goes where it is told.

The service ~hang makes the next step of navigation last until ~go_on is asked for.
"""

import os
import sys
import threading

import rospy
from std_srvs.srv import Empty, EmptyResponse

HERE = os.path.dirname(os.path.abspath(__file__))
sys.path[:0] = [os.path.join(HERE, ".."), os.path.join(HERE, "..", "unit", "navigation")]
import scripted  # noqa: E402
from node.paper_server import plan, steer  # noqa: E402
from node.paper_wheels import PaperWheels  # noqa: E402

from mbf_relay.ros.common.parameters import read_namespace  # noqa: E402
from mbf_relay.ros.common.transforms import Transforms  # noqa: E402
from mbf_relay.ros.costmap.node import make_costmap_nodes  # noqa: E402
from mbf_relay.ros.server.node import MoveBaseFlex  # noqa: E402


def main() -> None:
    """Serve until ROS goes down."""
    rospy.init_node("move_base_flex")
    script = scripted.SCRIPT
    script.plan, script.velocity, script.reached = plan, steer, lambda state: False
    wheels, transforms = PaperWheels(), Transforms()
    config = {**scripted.config(), **read_namespace("~")}
    nodes = make_costmap_nodes(config, transforms)
    server = MoveBaseFlex(config, {side: node.costmap for side, node in nodes.items()}, transforms, nodes)
    update, told = server.navigator.update, threading.Event()

    def hang(_request):
        def once(now):
            server.navigator.update = update
            told.wait(60.0)
            update(now)

        told.clear()
        server.navigator.update = once
        return EmptyResponse()

    def go_on(_request):
        told.set()
        return EmptyResponse()

    rospy.Service("~hang", Empty, hang)
    rospy.Service("~go_on", Empty, go_on)
    server.start()
    rospy.spin()
    wheels.stop()


if __name__ == "__main__":
    main()
