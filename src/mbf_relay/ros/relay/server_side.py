"""What the relay's node has to know of its server: one of another process, or one in its own."""

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
        """Whether it is known what the server calls the plugins that were asked for."""

    def plugin_names(self) -> Tuple[str, str]:
        """Return the server's names of the planner and the controller to use, empty for its first; asks nobody."""


class ServerSide(abc.ABC):
    """The server, as the relay's node sees it; its methods are called in their order, once each but for the last.

    Attributes:
        settings: move_base's parameters in force, once it has started.
    """

    settings: Settings

    @abc.abstractmethod
    def relay_parameters(self, namespace: Mapping[str, Any]) -> RelayParameters:
        """Return the relay's parameters.

        Args:
            namespace: What stands under the node on the parameter server.

        Raises:
            ValueError: One is wrong.
        """

    @abc.abstractmethod
    def start(self) -> None:
        """Come so far that goals can be composed."""

    @abc.abstractmethod
    def offer(self, where: Callable[[], PoseStamped]) -> None:
        """Offer what move_base has beside its goals, as far as the server does not; `where` gives the robot's pose."""

    @abc.abstractmethod
    def came(self) -> None:
        """Hear that the server is up, and was not before."""


class RemoteServer(ServerSide):
    """A server of another process: it is sent what was set for move_base, and what it offers is passed on."""

    def relay_parameters(self, namespace: Mapping[str, Any]) -> RelayParameters:
        """Return them as they were given, with the server's name as it is remapped; see ServerSide."""
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
        """Send the server what was wished for; see ServerSide."""
        self.settings.server_came()
