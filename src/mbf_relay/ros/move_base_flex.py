"""The Move Base Flex server: navigation stepped by one thread, with actions, services and costmaps around it."""

from __future__ import annotations

import math
import threading
from typing import Any, Dict, List, Mapping

import rospy

from mbf_relay.geometry import STOP
from mbf_relay.navigation.navigator import Navigator
from mbf_relay.navigation.parameters import NavigatorParameters
from mbf_relay.navigation.registry import Registry
from mbf_relay.navigation.worker import ThreadWorker
from mbf_relay.parameters import did_you_mean, nearest_of
from mbf_relay.ros import parameters as ros_parameters
from mbf_relay.ros import reconfigure
from mbf_relay.ros.controller_topics import serve_controllers
from mbf_relay.ros.costmap_rest import CostmapRest
from mbf_relay.ros.costmap_services import CostmapServices
from mbf_relay.ros.costmaps import CostmapNode
from mbf_relay.ros.diagnostics import ERROR, OK, WARN, Diagnostics, RateMeter, Report
from mbf_relay.ros.navigation_actions import make_actions
from mbf_relay.ros.navigation_topics import NavigationTopics
from mbf_relay.ros.node import spare_what_stays
from mbf_relay.ros.planner_potential import serve_planners
from mbf_relay.ros.planner_topics import PlannerTopics
from mbf_relay.ros.robot import COMMANDS_PAUSE, RosRobot
from mbf_relay.ros.stepper import Stepper
from mbf_relay.ros.transforms import Transforms

READ_ELSEWHERE = (
    "planners", "controllers", "recovery_behaviors", "planner_lock_costmap", "controller_lock_costmap",
    reconfigure.RESTORE_DEFAULTS,
)
"""Parameters of the node that are no NavigatorParameters; the locks are upstream's, whose need is gone here."""

COSTMAPS = ("global_costmap", "local_costmap")
"""Groups of parameters beside the plugins' own."""

FLUSH_TIME = 0.1
"""Wall seconds given to rospy's sending threads before the node goes down."""


class MoveBaseFlex:
    """The server's parts, wired.

    Args:
        config: The node's parameters.
        costmaps: "global" and "local", live.
        transforms: Where frames are looked up.
        costmap_nodes: What feeds the costmaps; empty where somebody else does.
    """

    def __init__(
        self, config: Mapping[str, Any], costmaps: Mapping[str, Any], transforms: Transforms,
        costmap_nodes: Mapping[str, Any],
    ) -> None:
        parameters = ros_parameters.fill(NavigatorParameters, config, "~", READ_ELSEWHERE)
        self.robot = RosRobot(
            transforms, parameters.robot_frame, parameters.odom_topic, parameters.pose_timeout,
            parameters.odom_timeout,
        )
        self._stepper = Stepper(self._step)
        worker = ThreadWorker(self._stepper.wake)
        self.navigator = Navigator(config, self.robot, costmaps, worker)
        registries = (self.navigator.planners, self.navigator.controllers, self.navigator.recoveries)
        for registry in registries:
            _log_plugins(registry, config)
        _warn_of_stray_groups(config, [name for registry in registries for name in registry.names])
        self._topics = NavigationTopics(self.navigator)
        planner_topics = PlannerTopics(self.navigator.planners.names)
        self.navigator.plan_watcher = lambda name, path: worker.start(lambda: planner_topics.publish(name, path))
        self._actions = make_actions(self.navigator)
        for action in self._actions:
            action.wake, action.worker, action.robot_frame = self._stepper.wake, worker, parameters.robot_frame
        self._costmap_nodes, self._transforms = costmap_nodes, transforms
        self._rest = CostmapRest(costmap_nodes, parameters.clear_on_shutdown)
        self._trouble = ""
        self._steps = RateMeter()
        self._closing = threading.Lock()

    def start(self) -> None:
        """Offer everything and begin stepping."""
        rospy.on_shutdown(self.close)
        self._reconfigure_server = _serve_reconfigure(self.navigator, self._stepper)
        self._controllers = serve_controllers(self.navigator.controllers)
        self._planners = serve_planners(self.navigator.planners)
        for node in self._costmap_nodes.values():
            node.start()
        if self._costmap_nodes:
            self._services = CostmapServices(
                self._costmap_nodes, self._transforms, self.navigator.parameters.robot_frame, self._ask_costmaps
            )
        self._stepper.start()
        for action in self._actions:
            action.start()
        self._diagnostics = Diagnostics()
        self._diagnostics.add("navigation", self._report)
        for side, node in self._costmap_nodes.items():
            self._diagnostics.add(f"{side} costmap", node.report)

    def close(self) -> None:
        """Leave the robot standing and every goal ended; nothing is sent to the wheels afterwards."""
        with self._closing:
            self._stepper.stop()
            self.robot.close()
            for action in self._actions:
                action.abort_all("STOPPED", "move_base_flex is shutting down")
            for node in self._costmap_nodes.values():
                node.close()
        threading.Event().wait(FLUSH_TIME)

    def _step(self, now: float) -> float:
        try:
            for action in self._actions:
                action.take_up()
            self.navigator.update(now)
            if not self.navigator.idle:
                self._trouble = ""  # goals are carried out again
            self._topics.publish(now)
            for action in self._actions:
                action.report()
            self._end_without_clock()
            self._steps.tick(now)
            rest = self._rest.attend(now, self.navigator.idle, self.navigator.parameters)
            return min(self.navigator.due, rest)
        except Exception as error:  # a mistake here must neither let the robot roll on nor end the server
            rospy.logfatal("navigation failed and stopped the robot: %s: %s", type(error).__name__, error, exc_info=True)
            self._trouble = f"{type(error).__name__}: {error}"
            self._start_over(f"Internal error: {self._trouble}")
            return math.inf

    def _end_without_clock(self) -> None:
        """End all goals where the simulated clock was lost: on it no patience ever ends and no pose ever gets old."""
        loss = "" if self.navigator.idle else self._stepper.clock_loss
        if loss:
            rospy.logerr("stopped the robot and ended its goals: %s", loss)
            self._start_over(loss)

    def _start_over(self, message: str) -> None:
        self.robot.command(STOP)
        self.navigator.drop_all()
        for action in self._actions:
            action.abort_all("INTERNAL_ERROR", message)

    def _ask_costmaps(self) -> bool:
        rested = self._rest.wake()
        self._stepper.wake()  # so that it looks again when they may rest
        return rested

    def _report(self) -> Report:
        asked, commands = self.navigator.parameters.controller_frequency, self.robot.commands
        age = commands.age(rospy.get_time())
        driving = not self.navigator.idle and age is not None and age <= COMMANDS_PAUSE
        values: Dict[str, object] = {
            "goal running": not self.navigator.idle, "steps [Hz]": f"{self._steps.rate():.1f}",
            "velocities asked for [Hz]": f"{asked:g}", "velocities [Hz]": f"{commands.rate():.1f}" if driving else "none",
        }
        if self._trouble:
            return ERROR, f"last internal error: {self._trouble}", values
        if driving and commands.lags(asked):
            return WARN, f"velocities at {commands.rate():.1f} Hz, asked for {asked:g} Hz: the machine is too slow for it", values
        return OK, "waiting for goals" if self.navigator.idle else "navigating", values


def _log_plugins(registry: "Registry[Any]", config: Mapping[str, Any]) -> None:
    for name in registry.names:
        made = registry.class_of(name)
        rospy.loginfo("%s: loaded '%s' of type %s (%s.%s)", registry.kind, name, registry.type_of(name),
                      made.__module__, made.__name__)
        ros_parameters.warn_of_unknown(made.Parameters, config.get(name) or {}, f"~{name}")
    if not registry.names:
        rospy.logwarn("%s: none are configured; goals that need one will be rejected", registry.kind)


def _warn_of_stray_groups(config: Mapping[str, Any], plugins: List[str]) -> None:
    """Warn about groups of parameters under a name that no plugin has: a misspelt name would leave all at defaults."""
    for name, values in config.items():
        if isinstance(values, Mapping) and name not in plugins and name not in COSTMAPS:
            hint = did_you_mean(nearest_of(name, [*plugins, *COSTMAPS]))
            rospy.logwarn("parameters under %s belong to no plugin that is loaded and are ignored%s",
                          rospy.resolve_name(f"~{name}"), hint)


def _serve_reconfigure(navigator: Navigator, stepper: Stepper) -> Any:
    from mbf_relay.cfg import MoveBaseFlexConfig

    def apply(parameters: NavigatorParameters) -> None:
        navigator.reconfigure(parameters)
        stepper.wake()

    return reconfigure.serve(MoveBaseFlexConfig, navigator.parameters, apply)


def main() -> None:
    """Run the server until ROS goes down."""
    config = ros_parameters.read_namespace("~")
    transforms = Transforms()
    nodes = {side: CostmapNode(f"{side}_costmap", config, transforms) for side in ("global", "local")}
    server = MoveBaseFlex(config, {side: node.costmap for side, node in nodes.items()}, transforms, nodes)
    server.start()
    spare_what_stays()
    rospy.loginfo("move_base_flex is ready")
    rospy.spin()
