"""The node `move_base`: topics, services and the action around the relay."""

from __future__ import annotations

import math
import threading
import time
from typing import Any, Dict, Optional

import rospy
from actionlib_msgs.msg import GoalID, GoalStatus
from geometry_msgs.msg import PoseStamped, Twist
from mbf_msgs.msg import MoveBaseAction, MoveBaseActionResult, MoveBaseGoal, MoveBaseResult
from move_base_msgs import msg as move_base_msgs

from mbf_relay.ros.common import parameters as ros_parameters
from mbf_relay.ros.common.actions.action_client import ActionClient
from mbf_relay.ros.common.actions.action_server import ActionServer
from mbf_relay.ros.common.actions.server_watch import check_alone
from mbf_relay.ros.common.diagnostics import ERROR, OK, WARN, Diagnostics, Report
from mbf_relay.ros.common.node import on_shutdown, spare_what_stays
from mbf_relay.ros.relay.answers import Answer
from mbf_relay.ros.relay.goal_frame import GoalFrame
from mbf_relay.ros.relay.reconfigure import wishes
from mbf_relay.ros.relay.relay import ClientGoal, Observer, Relay, RelayParameters
from mbf_relay.ros.relay.server_side import RemoteServer, ServerSide, Settings

CHECK_PERIOD = 0.1
"""Wall time (s) between two checks of the server and of timeouts."""


def serve(action: bool = True, topic: bool = True, side: Optional[ServerSide] = None) -> None:
    """Run the node until ROS shuts down.

    Args:
        action: Whether to serve the action move_base.
        topic: Whether to take goals from move_base_simple/goal.
        side: The server; None for one in another process.
    """
    side = side or RemoteServer()
    parameters = side.relay_parameters(wishes(ros_parameters.read_namespace("~")))
    if action:
        check_alone("move_base")
    client = ActionClient(
        f"{parameters.server}/move_base",
        MoveBaseAction,
        parameters.acknowledge_timeout,
        parameters.silence_timeout,
        leased=True,
    )
    side.start()
    settings = side.settings
    publishers = Publishers(parameters)

    def compose(pose: PoseStamped) -> MoveBaseGoal:
        planner, controller = settings.plugin_names()
        return MoveBaseGoal(
            target_pose=pose, planner=planner, controller=controller, recovery_behaviors=list(settings.recoveries))

    server = ActionServer(
        "move_base", move_base_msgs.MoveBaseAction,
        lambda goal: relay.take_goal(goal, rospy.get_time()), lambda goal: relay.take_cancel(goal),
        overtaken_cb=lambda goal: relay.take_overtaken(goal, rospy.get_time()),
    ) if action else None
    relay = Relay(
        KnownServer(client, settings), compose, parameters, publishers, server.lock if server else threading.RLock()
    )
    on_shutdown(relay.shut_down)  # before the first goal can come
    side.offer(lambda: publishers.robot_pose)
    diagnostics = Diagnostics()
    diagnostics.add("relay", lambda: report(relay, client, parameters.server, publishers))
    spare_what_stays()
    # goals are taken last: the above may take long on a busy machine, and _attend has to renew their leases
    if server is not None:
        server.start()
        check_alone("move_base")
    poses = SimpleGoals(relay, through_action=action) if topic else None
    rospy.loginfo("move_base is here, carried out by %s", rospy.resolve_name(parameters.server))
    _attend(client, relay, side, poses)


def _attend(client: ActionClient, relay: Relay, side: ServerSide, poses: Optional[SimpleGoals]) -> None:
    """Check the server and all timeouts periodically until ROS shuts down.

    Nothing here may block, since `client.check` renews the lease of the goal that the robot drives for.
    """
    was_up = False
    while not rospy.is_shutdown():
        client.check()
        is_up = client.server_is_up
        if is_up and not was_up:
            side.came()
        was_up = is_up
        relay.check()
        if poses is not None:
            poses.check()
        time.sleep(CHECK_PERIOD)


class KnownServer:
    """ServerClient that counts as up only once the server's names of the chosen plugins are known."""

    def __init__(self, client: ActionClient, settings: Settings) -> None:
        self._client, self._settings = client, settings
        self.send = client.send

    @property
    def server_is_up(self) -> bool:
        """Whether a goal can be composed and sent."""
        return self._client.server_is_up and self._settings.knows_server


def report(relay: Relay, client: ActionClient, server: str, publishers: Publishers) -> Report:
    """Return the status for /diagnostics: whether the server is there, and counts of how goals ended."""
    is_up, silence = client.server_is_up, client.server_silence
    values = {
        "server": server,
        "server there": is_up,
        "server's last word [s]": "none" if math.isinf(silence) else f"{silence:.1f}",
        "goal running": relay.is_pursuing,
        **publishers.endings,
    }
    if is_up:
        return OK, "driving to a goal" if relay.is_pursuing else "ready for goals", values
    level = ERROR if relay.is_pursuing else WARN
    return level, f"the Move Base Flex server {rospy.resolve_name(server)} is not there", values


class Publishers(Observer):
    """Publishes ~current_goal, ~navigation_outcome and the zero velocities."""

    def __init__(self, parameters: RelayParameters) -> None:
        publisher = rospy.Publisher
        self._goal = publisher("~current_goal", PoseStamped, queue_size=10)
        self._outcome = publisher("~navigation_outcome", MoveBaseActionResult, queue_size=50, tcp_nodelay=True)
        stops = parameters.stop_on_server_loss
        self._velocity = publisher("cmd_vel", Twist, queue_size=1, tcp_nodelay=True) if stops else None
        self._frame = GoalFrame(parameters.global_frame, self._goal.publish)
        self.robot_pose = PoseStamped()
        self.endings: Dict[str, Any] = {
            "goals reached": 0,
            "goals preempted": 0,
            "goals aborted": 0,
            "last outcome": "",
        }

    def goal_taken(self, pose: PoseStamped) -> None:
        """Publish ~current_goal."""
        self._frame.show(pose)

    def goal_ended(self, client_goal: ClientGoal, answer: Answer, result: Optional[MoveBaseResult]) -> None:
        """Publish ~navigation_outcome and log the reason, which move_base's text does not have."""
        goal_id = client_goal.get_goal_id()
        ended = {GoalStatus.SUCCEEDED: "goals reached", GoalStatus.ABORTED: "goals aborted"}
        self.endings[ended.get(answer.status, "goals preempted")] += 1
        self.endings["last outcome"] = answer.reason or answer.text
        if answer.status == GoalStatus.ABORTED:
            rospy.logerr("goal %s aborted: %s", goal_id.id, answer.reason)  # an error in C++, too
        elif answer.reason:
            rospy.loginfo("goal %s ended: %s", goal_id.id, answer.reason)
        outcome = MoveBaseActionResult(result=result if result is not None else nothing_known(answer))
        outcome.header.stamp = rospy.get_rostime()
        outcome.status = GoalStatus(goal_id=goal_id, status=answer.status, text=answer.text)
        self._outcome.publish(outcome)

    def robot_seen(self, pose: PoseStamped) -> None:
        """Store the robot's pose."""
        self.robot_pose = pose

    def stop_robot(self) -> None:
        """Publish a zero velocity if stop_on_server_loss is set."""
        if self._velocity is not None:
            self._velocity.publish(Twist())


def nothing_known(answer: Answer) -> MoveBaseResult:
    """Return a result for a goal that has none from the server."""
    outcome = MoveBaseResult.CANCELED if answer.status == GoalStatus.PREEMPTED else MoveBaseResult.INTERNAL_ERROR
    return MoveBaseResult(outcome=outcome, message=answer.reason or answer.text)


class SimpleGoals:
    """Subscriber of move_base_simple/goal that turns poses into goals."""

    def __init__(self, relay: Relay, through_action: bool) -> None:
        """Prepare; `check` subscribes.

        Args:
            relay: Takes the goals directly if `through_action` is False.
            through_action: Whether to publish them as goals of the action, visible to all clients, as move_base does.
        """
        self._relay, self._count = relay, 0
        self._goals: Optional[rospy.Publisher] = None
        self._poses: Optional[rospy.Subscriber] = None
        if through_action:
            self._goals = rospy.Publisher(
                f"{rospy.resolve_name('move_base')}/goal", move_base_msgs.MoveBaseActionGoal, queue_size=10,
                tcp_nodelay=True)

    def check(self) -> None:
        """Subscribe once this node's publisher of goals is connected to its own action server.

        A latched pose arrives right after subscribing, and its goal would be lost before.
        """
        if self._poses is None and (self._goals is None or self._goals.impl.has_connection(rospy.get_name())):
            self._poses = rospy.Subscriber(
                f"{rospy.resolve_name('move_base_simple')}/goal", PoseStamped, self._take, queue_size=10,
                tcp_nodelay=True)

    def _take(self, pose: PoseStamped) -> None:
        if self._goals is not None:
            message = move_base_msgs.MoveBaseActionGoal(goal=move_base_msgs.MoveBaseGoal(target_pose=pose))
            message.header.stamp = rospy.get_rostime()
            self._goals.publish(message)
        else:
            self._count += 1
            self._relay.take_goal(TopicGoal(pose, self._count), rospy.get_time())


class TopicGoal:
    """ClientGoal for a pose from the topic, in a relay without the action; only ~navigation_outcome tells how it ended.

    Its stamp is not older than the pose's, so that the sender can match the outcome.
    """

    def __init__(self, pose: PoseStamped, number: int) -> None:
        # not older than now: the last pose is the newest goal, even if its sender's clock is behind
        stamp = max(pose.header.stamp, rospy.get_rostime())
        self._goal = move_base_msgs.MoveBaseGoal(target_pose=pose)
        self._id = GoalID(stamp=stamp, id=f"{rospy.get_name()}-topic-{number}-{stamp.to_sec():.3f}")

    def get_goal(self) -> move_base_msgs.MoveBaseGoal:
        """Return the goal."""
        return self._goal

    def get_goal_id(self) -> GoalID:
        """Return the id given here."""
        return self._id

    def publish_feedback(self, feedback: Any) -> None:
        """Do nothing: there is no client."""

    def set_accepted(self, text: str = "") -> None:
        """Do nothing, as for the other states: there is no client."""

    def set_succeeded(self, result: Any = None, text: str = "") -> None:
        """See set_accepted."""

    set_canceled = set_aborted = set_succeeded
