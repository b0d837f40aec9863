"""The Move Base Flex server: planning, driving and recovering as actions, with the costmaps and their services."""

from __future__ import annotations

import functools
import math
import warnings
from typing import Any, Callable, Dict, List, Mapping

import rospy

from mbf_relay.geometry import STOP
from mbf_relay.navigation.examination import READ_BY_THE_NODE, SIDES, names_a_plugin, stray_groups
from mbf_relay.navigation.navigator import Navigator
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.registry import Registry
from mbf_relay.navigation.sanity import doubts
from mbf_relay.navigation.worker import ThreadWorker
from mbf_relay.planning.path import Path
from mbf_relay.ros.common import parameters as ros_parameters
from mbf_relay.ros.common import reconfigure
from mbf_relay.ros.common.actions.action_server import ActionServer, start_together
from mbf_relay.ros.common.diagnostics import ERROR, OK, WARN, Diagnostics, RateMeter, Report
from mbf_relay.ros.common.node import on_shutdown, spare_what_stays
from mbf_relay.ros.common.stepper import Stepper
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.ros.costmap.node import CostmapNode, make_costmap_nodes
from mbf_relay.ros.server.actions import make_actions
from mbf_relay.ros.server.controller_topics import serve_controller, serve_controllers
from mbf_relay.ros.server.costmap_rest import CostmapRest
from mbf_relay.ros.server.costmap_services import CostmapServices
from mbf_relay.ros.server.pause_services import PauseServices
from mbf_relay.ros.server.plan_services import PlanServices
from mbf_relay.ros.server.planner_topics import PlanPublisher, serve_planner, serve_planners
from mbf_relay.ros.server.robot import COMMANDS_PAUSE, RosRobot
from mbf_relay.ros.server.topics import NavigationTopics
from mbf_relay.ros.server.watchdog import Watchdog


class MoveBaseFlex:
    """The server: navigator, actions, services and topics.

    Args:
        config: The node's parameters.
        costmaps: "global" and "local", live.
        transforms: Where frames are looked up.
        costmap_nodes: Nodes that update the costmaps; empty where the caller updates them.
        is_move_base: Whether the node is move_base; its relay then offers move_base's parameters and `~current_goal`.
        planner: Returns the name of the planner for `~make_plan`; empty for the first.
    """

    def __init__(
        self, config: Mapping[str, Any], costmaps: Mapping[str, Any], transforms: Transforms,
        costmap_nodes: Mapping[str, CostmapNode], is_move_base: bool = False, planner: Callable[[], str] = lambda: "",
    ) -> None:
        self._is_move_base, self._planner = is_move_base, planner
        # in a node move_base, other names are the relay's; groups are checked by _warn_of_stray_groups
        told_of = config if is_move_base else (*READ_BY_THE_NODE, *ros_parameters.groups_in(config))
        ros_parameters.warn_of_own_file_beside((*NavigatorParameters.names(), *READ_BY_THE_NODE, *SIDES))
        parameters = ros_parameters.fill(NavigatorParameters, config, "~", told_of)
        ros_parameters.warn_of_tf_prefix(parameters.robot_frame)
        self.robot = RosRobot(
            transforms, parameters.robot_frame, lambda: parameters.oldest_pose(costmaps.values()),
            parameters.odom_timeout,
        )
        self._stepper = Stepper(self._step)
        worker = ThreadWorker(self._stepper.wake)
        self.navigator = Navigator(config, self.robot, costmaps, worker)
        self.robot.listen(self.navigator.odom_topic)
        registries = (self.navigator.planners, self.navigator.controllers, self.navigator.recoveries)
        for registry in registries:
            _log_plugins(registry)
        _warn_of_stray_groups(config, [name for registry in registries for name in (*registry.names, *registry.failed)])
        for name, doubt in doubts(config):
            rospy.logwarn("parameter %s %s", rospy.resolve_name(f"~{name}"), doubt)
        self._topics = NavigationTopics(self.navigator, is_move_base)
        self._plans = plans = PlanPublisher(self.navigator.planners.names)

        def publish_plan(name: str, path: Path) -> None:
            worker.start(lambda: plans.publish(name, path))

        self.navigator.plan_watcher = publish_plan
        self._watchdog = Watchdog(self._stepper, self.robot, self._end_running, self._hung_costmaps)
        make_server = functools.partial(
            ActionServer, client_timeout=parameters.client_timeout, is_alive=self._watchdog.is_alive)
        self._actions = make_actions(self.navigator, make_server, worker=worker, wake=self._stepper.wake)
        self._costmap_nodes, self._transforms = costmap_nodes, transforms
        self._rest = CostmapRest(costmap_nodes, parameters.clear_on_shutdown)
        self._trouble = ""
        self._steps = RateMeter()

    def start(self) -> None:
        """Advertise all services, topics and actions and start the stepping thread."""
        on_shutdown(self.close)
        if not self._is_move_base:
            _serve_reconfigure(self.navigator, self.reconfigure)
        serve_controllers(self.navigator.controllers)
        serve_planners(self.navigator.planners)
        for node in self._costmap_nodes.values():
            node.start()
        if self._costmap_nodes:
            self._services = CostmapServices(
                self._costmap_nodes, self._transforms, self.navigator.parameters.robot_frame, self._ask_costmaps
            )
        self._plan_services = PlanServices(self.navigator, self._planner, self._rouse)
        PauseServices(self.robot, self._stepper.wake)
        self._stepper.start()
        self._watchdog.start()
        start_together([action.server for action in self._actions])
        diagnostics = Diagnostics()
        diagnostics.add("navigation", self._report)
        for side, node in self._costmap_nodes.items():
            diagnostics.add(f"{side} costmap", node.report)

    def add_plugin(self, kind: str, name: str, type_name: str) -> None:
        """Load a planner or a controller at run time; do nothing where there is one of that name.

        Args:
            kind: "planners" or "controllers".
            name: Its name and its group of parameters.
            type_name: Its type.

        Raises:
            PluginError: It cannot be made.
        """
        registry: Any = self.navigator.planners if kind == "planners" else self.navigator.controllers
        if name in registry.names:
            return
        registry.add(name, type_name)
        if kind == "planners":
            self._plans.add(name)
            self._plan_services.add(name)
            serve_planner(registry, name)
        else:
            serve_controller(registry, name)

    def reconfigure(self, parameters: NavigatorParameters) -> None:
        """Use new parameters from the next step on."""
        self.navigator.reconfigure(parameters)
        self._stepper.wake()

    def close(self) -> None:
        """Stop the robot and end all goals; no velocity is sent afterwards."""
        self.robot.close()  # first, since the rest may take time
        self._watchdog.stop()
        self._stepper.stop()
        for action in self._actions:
            action.abort_all("STOPPED", "move_base_flex is shutting down")
        for node in self._costmap_nodes.values():
            node.close()

    def _step(self, now: float) -> float:
        try:
            hung = self._watchdog.settle()
            if hung:
                self._trouble = hung
                self.robot.command(STOP)
                self.navigator.drop_all()
                self._end_running(hung)
            more = [action.take_up() for action in self._actions]
            self.navigator.update(now)
            if not self.navigator.idle:
                self._trouble = ""  # goals are carried out again
            self._topics.publish(now)
            for action in self._actions:
                action.report()
            self._end_without_clock()
            self._steps.tick(now)
            rest = self._rest.attend(now, self.navigator.idle, self.navigator.parameters)
            return now if any(more) else min(self.navigator.due, rest)
        except Exception as error:  # an internal error must stop the robot, and not end the server
            rospy.logfatal(
                "navigation failed and stopped the robot: %s: %s", type(error).__name__, error, exc_info=True
            )
            self._trouble = f"{type(error).__name__}: {error}"
            self._start_over(f"Internal error: {self._trouble}")
            return math.inf

    def _end_without_clock(self) -> None:
        """End all goals where the simulated clock was lost, since no timeout in ROS time would ever end."""
        loss = "" if self.navigator.idle else self._stepper.clock_loss
        if loss:
            rospy.logerr("stopped the robot and ended its goals: %s", loss)
            self._start_over(loss)

    def _end_running(self, message: str) -> None:
        for action in self._actions:
            action.abort_running("INTERNAL_ERROR", message)

    def _hung_costmaps(self) -> List[str]:
        places = {side: node.hangs_in for side, node in self._costmap_nodes.items()}
        return [f"{side} costmap hangs in {place}" for side, place in places.items() if place]

    def _start_over(self, message: str) -> None:
        self.robot.command(STOP)
        self.navigator.drop_all()
        for action in self._actions:
            action.abort_all("INTERNAL_ERROR", message)

    def _ask_costmaps(self) -> bool:
        rested = self._rest.wake()
        self._stepper.wake()  # so that it looks again when they may rest
        return rested

    def _rouse(self, side: str) -> None:
        if self._costmap_nodes:
            self._services.rouse(side)

    def _report(self) -> Report:
        asked, commands = self.navigator.parameters.controller_frequency, self.robot.commands
        age = commands.age(rospy.get_time())
        driving = not self.navigator.idle and age is not None and age <= COMMANDS_PAUSE
        values: Dict[str, object] = {
            "goal running": not self.navigator.idle,
            "steps [Hz]": f"{self._steps.rate():.1f}",
            "velocities asked for [Hz]": f"{asked:g}",
            "velocities [Hz]": f"{commands.rate():.1f}" if driving else "none",
            "velocities take effect after [s]": f"{self.robot.delay.seconds:.2f}",
        }
        if not self._watchdog.is_alive():
            return ERROR, self._watchdog.trouble or "navigation hangs", values
        if self._trouble:
            return ERROR, f"last internal error: {self._trouble}", values
        if driving and self.robot.waits_for:
            return WARN, f"the robot stands: {self.robot.waits_for}", values
        if driving and commands.lags(asked):
            return (
                WARN,
                f"velocities at {commands.rate():.1f} Hz, asked for {asked:g} Hz: the machine is too slow for it",
                values,
            )
        if self.robot.paused:
            return OK, "paused; ~resume lets drives go on", values
        return OK, "waiting for goals" if self.navigator.idle else "navigating", values


def _log_plugins(registry: Registry[Any]) -> None:
    for name in registry.names:
        made = registry.class_of(name)
        rospy.loginfo("%s: loaded '%s' of type %s (%s.%s)", registry.kind, name, registry.type_of(name),
                      made.__module__, made.__name__)
        ros_parameters.warn_of_unknown(made.Parameters, registry.values(name), f"~{name}")
        ros_parameters.warn_of(registry.plugin(name).notes, f"~{name}")
    for name, reason in registry.failed.items():
        rospy.logerr("%s: '%s' was not loaded; goals that need it will be rejected: %s", registry.kind, name, reason)
    if not registry.names and not registry.failed:
        rospy.logwarn("%s: none are configured; goals that need one will be rejected", registry.kind)


def _warn_of_stray_groups(config: Mapping[str, Any], plugins: List[str]) -> None:
    for name, hint in stray_groups(config, plugins).items():
        log = rospy.loginfo if names_a_plugin(name) else rospy.logwarn
        log("parameters under %s belong to no plugin that is loaded and are ignored%s",
            rospy.resolve_name(f"~{name}"), hint)


def _serve_reconfigure(navigator: Navigator, apply: Callable[[NavigatorParameters], None]) -> None:
    from mbf_relay.cfg import MoveBaseFlexConfig

    reconfigure.serve(MoveBaseFlexConfig, navigator.parameters, apply)


def main() -> None:
    """Run the server until ROS goes down."""
    warnings.showwarning = lambda message, *_, **__: rospy.logwarn("%s", message)
    config = ros_parameters.read_namespace("~")
    transforms = Transforms()
    nodes = make_costmap_nodes(config, transforms)
    server = MoveBaseFlex(config, {side: node.costmap for side, node in nodes.items()}, transforms, nodes)
    server.start()
    spare_what_stays()
    rospy.loginfo("move_base_flex is ready")
    rospy.spin()
