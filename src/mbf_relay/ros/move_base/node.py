"""The node move_base, with the relay and the Move Base Flex server in one process.

In a launch file written for move_base only `pkg` changes, to "mbf_relay". Topics, services, actions, parameters and
dynamic_reconfigure have move_base's names; the node also has the actions and services of a Move Base Flex server.
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
"""arrival_tolerance (m) that no goal exceeds: in the same process the controller's own tolerance decides."""
LOOK_PERIOD = 0.05
"""Wall time (s) between checks whether the costmaps have the inputs they need."""
SAY_PERIOD = 5.0
"""Wall time (s) between two log lines on what the node waits for."""


class MoveBaseServer(ServerSide):
    """The server in the relay's process, which itself has move_base's topics and services of costmaps and plans."""

    settings: OwnSettings

    def __init__(self, namespace: Mapping[str, Any]) -> None:
        """Make costmaps and plugins.

        Args:
            namespace: The parameters in the node's private namespace.

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
        """Return the parameters of a relay whose server is in its process; see ServerSide."""
        given, notes = RelayParameters.read(namespace)
        ros_parameters.warn_of(notes, "~")
        return with_own_server(given, self._global_frame)

    def start(self) -> None:
        """Start the server; return when the costmaps have their inputs: as in move_base, no goals are taken before.

        Raises:
            rospy.ROSInterruptException: The node shuts down.
        """
        self._server.start()
        self.settings.serve(self._server)
        said = float("-inf")
        while not rospy.is_shutdown():
            missing = self._missing()
            if not missing:
                return
            if time.monotonic() - said > SAY_PERIOD:
                rospy.logwarn("move_base waits for what it needs: %s", "; ".join(dict.fromkeys(missing)))
                said = time.monotonic()
            time.sleep(LOOK_PERIOD)
        raise rospy.ROSInterruptException("shut down while waiting for what the costmaps need")

    def offer(self, where: Callable[[], PoseStamped]) -> None:
        """Do nothing: the server in this process offers all of it."""

    def came(self) -> None:
        """Do nothing: the server in this process has the settings already."""

    def _missing(self) -> List[str]:
        """Return what the costmaps still wait for, such as a first map or scan."""
        return [reason for reason in (node.missing_input() for node in self._nodes.values()) if reason]


def with_own_server(given: RelayParameters, global_frame: str) -> RelayParameters:
    """Return a relay's parameters for a server in its own process, whose controller alone judges arrivals."""
    return given.replace(server=rospy.get_name(), global_frame=global_frame, arrival_tolerance=ANYWHERE)


def main() -> None:
    """Run the node until it is shut down."""
    serve(side=MoveBaseServer(ros_parameters.read_namespace("~")))
