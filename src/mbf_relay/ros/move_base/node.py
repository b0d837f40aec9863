"""The node move_base by itself: a launch file written for move_base needs `pkg="mbf_relay"` and nothing else.

Topics, services, actions, parameters and dynamic_reconfigure stand under the names they have there, and beside them
what a Move Base Flex server has.
"""

from __future__ import annotations

import time
from typing import Any, List, Mapping

import rospy

from mbf_relay.costmap.factory import SEARCHED_NAMES
from mbf_relay.navigation.move_base_files import server_config
from mbf_relay.navigation.move_base_parameters import OTHER_MOVE_BASE_NAMES, MoveBaseParameters
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.ros.common import parameters as ros_parameters
from mbf_relay.ros.common.node import spare_what_stays
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.ros.costmap.node import CostmapNode
from mbf_relay.ros.move_base.settings import OwnSettings
from mbf_relay.ros.relay.node import serve
from mbf_relay.ros.relay.relay import RelayParameters
from mbf_relay.ros.server.node import MoveBaseFlex

LOOK_PERIOD = 0.05
"""Wall time (s) between looks at whether goals can be carried out."""
SAY_PERIOD = 5.0
"""Wall time (s) after which a node that waits says again for what."""


class MoveBaseServer:
    """The server's half of the node, with what the relay's half has to know of it.

    Attributes:
        settings: move_base's parameters in force.
    """

    def __init__(self, namespace: Mapping[str, Any]) -> None:
        """Make costmaps and plugins.

        Args:
            namespace: What stands under the node on the parameter server.

        Raises:
            ValueError: A parameter is wrong.
        """
        elsewhere = (
            *OTHER_MOVE_BASE_NAMES, *RelayParameters.names(), *NavigatorParameters.names(), *SEARCHED_NAMES,
            *ros_parameters.groups_in(namespace),
        )
        values = ros_parameters.fill(MoveBaseParameters, namespace, "~", elsewhere)
        self.settings = OwnSettings(values, namespace)
        relays = set(RelayParameters.names()) - set(NavigatorParameters.names())
        config = {name: value for name, value in server_config(namespace, values).items() if name not in relays}
        self.global_frame = config["global_frame"]
        transforms = Transforms()
        self._nodes = {side: CostmapNode(f"{side}_costmap", config, transforms) for side in ("global", "local")}
        costmaps = {side: node.costmap for side, node in self._nodes.items()}
        self._server = MoveBaseFlex(
            config,
            costmaps,
            transforms,
            self._nodes,
            is_move_base=True,
            planner=lambda: self.settings.plugin_names()[0],
        )

    def start(self) -> None:
        """Serve, and wait until a goal can be carried out, as move_base does; only then it takes any."""
        self._server.start()
        self.settings.serve(self._server)
        said = float("-inf")
        while not rospy.is_shutdown():
            missing = self._missing()
            if not missing:
                break
            if time.monotonic() - said > SAY_PERIOD:
                rospy.logwarn("move_base waits: %s", "; ".join(missing))
                said = time.monotonic()
            time.sleep(LOOK_PERIOD)
        spare_what_stays()

    def _missing(self) -> List[str]:
        """Return what the costmaps have never had and show nothing without."""
        return [reason for reason in (node.missing_input() for node in self._nodes.values()) if reason]


def main() -> None:
    """Stand in for move_base until the node ends."""
    serve(own=MoveBaseServer(ros_parameters.read_namespace("~")))
