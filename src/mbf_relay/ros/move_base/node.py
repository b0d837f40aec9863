"""The node move_base by itself: a launch file written for move_base needs `pkg="mbf_relay"` and nothing else.

Topics, services, actions, parameters and dynamic_reconfigure have the names they have in move_base; those of a Move
Base Flex server are there too.
"""

from __future__ import annotations

import time
from typing import Any, Callable, List, Mapping

import rospy
from geometry_msgs.msg import PoseStamped

from mbf_relay.costmap.factory import SEARCHED_NAMES
from mbf_relay.navigation.move_base_files import driven_by, recovery_notes, server_config
from mbf_relay.navigation.move_base_parameters import OTHER_MOVE_BASE_NAMES, MoveBaseParameters
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.ros.common import parameters as ros_parameters
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.ros.costmap.node import make_costmap_nodes
from mbf_relay.ros.move_base.settings import OwnSettings
from mbf_relay.ros.relay.node import serve
from mbf_relay.ros.relay.relay import RelayParameters
from mbf_relay.ros.relay.server_side import ServerSide
from mbf_relay.ros.server.node import MoveBaseFlex

ANYWHERE = 1e9
"""Metres from its goal within which every arrival is."""
LOOK_PERIOD = 0.05
"""Wall time (s) between looks at whether goals can be carried out."""
SAY_PERIOD = 5.0
"""Wall time (s) after which a node that waits says again for what."""


class MoveBaseServer(ServerSide):
    """The server's half of the node, which has move_base's topics and services itself, for the relay's half."""

    settings: OwnSettings

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
        values = driven_by(ros_parameters.fill(MoveBaseParameters, namespace, "~", elsewhere), namespace)
        self.settings = OwnSettings(values, namespace)
        ros_parameters.warn_of(recovery_notes(namespace), "~")
        relays = set(RelayParameters.names()) - set(NavigatorParameters.names())
        config = {name: value for name, value in server_config(namespace, values).items() if name not in relays}
        self._global_frame = config["global_frame"]
        transforms = Transforms()
        self._nodes = make_costmap_nodes(config, transforms)
        costmaps = {side: node.costmap for side, node in self._nodes.items()}
        self._server = MoveBaseFlex(
            config,
            costmaps,
            transforms,
            self._nodes,
            is_move_base=True,
            planner=lambda: self.settings.plugin_names()[0],
        )

    def relay_parameters(self, namespace: Mapping[str, Any]) -> RelayParameters:
        """Return those of a relay whose server is in its process; see ServerSide."""
        given, notes = RelayParameters.read(namespace)
        ros_parameters.warn_of(notes, "~")
        return with_own_server(given, self._global_frame)

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
                rospy.logwarn("move_base waits for what it needs: %s", "; ".join(dict.fromkeys(missing)))
                said = time.monotonic()
            time.sleep(LOOK_PERIOD)

    def offer(self, where: Callable[[], PoseStamped]) -> None:
        """Do nothing: the server beside offers all of it."""

    def came(self) -> None:
        """Do nothing: the server beside has the settings already."""

    def _missing(self) -> List[str]:
        """Return what the costmaps have never had and show nothing without."""
        return [reason for reason in (node.missing_input() for node in self._nodes.values()) if reason]


def with_own_server(given: RelayParameters, global_frame: str) -> RelayParameters:
    """Return a relay's parameters where the server is in its process: when the robot is there, its controller says."""
    return given.replace(server=rospy.get_name(), global_frame=global_frame, arrival_tolerance=ANYWHERE)


def main() -> None:
    """Stand in for move_base until the node ends."""
    serve(side=MoveBaseServer(ros_parameters.read_namespace("~")))
