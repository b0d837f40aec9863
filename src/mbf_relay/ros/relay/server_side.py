"""Interface of the relay's node to its server, which runs in another process or in the same one."""

from __future__ import annotations

import abc
import dataclasses
from typing import Any, Callable, Dict, Mapping, Protocol, Tuple

import rospy
from geometry_msgs.msg import PoseStamped

from mbf_relay.navigation.move_base_parameters import OTHER_MOVE_BASE_NAMES, MoveBaseParameters
from mbf_relay.ros.common import parameters as ros_parameters
from mbf_relay.ros.relay.reconfigure import MoveBaseSettings, tell_of_misplaced
from mbf_relay.ros.relay.relay import RelayParameters
from mbf_relay.ros.relay.services import ClearCostmaps, MakePlan, PauseByServer
from mbf_relay.ros.relay.topics import RecoveryTopic, pass_through


class Settings(Protocol):
    """move_base's parameters in force.

    Attributes:
        recoveries: The order of recovery behaviours; empty for the server's own.
    """

    recoveries: Tuple[str, ...]

    @property
    def knows_server(self) -> bool:
        """Whether the server's names of the chosen plugins are known."""

    def plugin_names(self) -> Tuple[str, str]:
        """Return the server's names of the planner and the controller to use, empty for its first; does not block."""


class ServerSide(abc.ABC):
    """The server. The methods are called in the order given here, once each, but `came` each time the server appears.

    Attributes:
        settings: move_base's parameters in force, once it has started.
    """

    settings: Settings

    @abc.abstractmethod
    def relay_parameters(self, namespace: Mapping[str, Any]) -> RelayParameters:
        """Return the relay's parameters.

        Args:
            namespace: The parameters in the node's private namespace.

        Raises:
            ValueError: A value is not allowed.
        """

    @abc.abstractmethod
    def start(self) -> None:
        """Prepare all that is needed to compose goals."""

    @abc.abstractmethod
    def offer(self, where: Callable[[], PoseStamped]) -> None:
        """Offer move_base's services and topics, unless the server does; `where` returns the robot's pose."""

    @abc.abstractmethod
    def came(self) -> None:
        """Called when the server has come up."""


class RemoteServer(ServerSide):
    """A server in another process; move_base's parameters are forwarded to it, its services and topics passed on."""

    def relay_parameters(self, namespace: Mapping[str, Any]) -> RelayParameters:
        """Return them with the server's name resolved; see ServerSide."""
        known = MoveBaseParameters.names() + OTHER_MOVE_BASE_NAMES + ros_parameters.groups_in(namespace)
        given = ros_parameters.fill(RelayParameters, namespace, "~", known)
        self._parameters = dataclasses.replace(given, server=rospy.resolve_name(given.server))
        self._namespace: Dict[str, Any] = dict(namespace)
        return self._parameters

    def start(self) -> None:
        """Read move_base's own parameters; the server may come later."""
        values = ros_parameters.fill(MoveBaseParameters, MoveBaseParameters.known(self._namespace), "~")
        tell_of_misplaced(self._namespace, self._parameters.server)
        self.settings: MoveBaseSettings = MoveBaseSettings(self._parameters.server, values)

    def offer(self, where: Callable[[], PoseStamped]) -> None:
        """Offer move_base's services, topics and reconfigure server; see ServerSide."""
        parameters = self._parameters
        MakePlan(parameters, self.settings)
        ClearCostmaps(parameters.server, parameters.service_timeout)
        PauseByServer(parameters.server, parameters.service_timeout)
        pass_through(parameters.server, self.settings.server_name)
        RecoveryTopic(parameters.server, where)
        self.settings.serve()

    def came(self) -> None:
        """Forward the parameters that were set; see ServerSide."""
        self.settings.server_came()
