"""The tutorials' clients: drive somewhere, say how it went, exit with 0 only if the robot got there, 130 on a signal.

mb_relay_client.py   the circle, through move_base's action, its goal topic, or waypoint_follower
movebase_client.py   one goal through move_base's action
mbf_goal_client.py   the circle through Move Base Flex's move_base
mbf_path_client.py   the circle through Move Base Flex's get_path and exe_path
"""

from __future__ import annotations

import argparse
import sys
import time
from typing import Any, Callable, List, NoReturn, Optional, Sequence

import rosgraph
import rospy
from actionlib_msgs.msg import GoalStatus
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from mbf_msgs import msg as mbf_msgs
from move_base_msgs.msg import MoveBaseAction, MoveBaseGoal

from mbf_relay.commands import finite, positive
from mbf_relay.ros.common.actions.action_client import ActionClient
from mbf_relay.ros.common.actions.client_goals import ActionEnding
from mbf_relay.ros.common.conversions import quaternion_from_yaw
from mbf_relay.ros.common.node import on_shutdown
from mbf_relay.ros.common.outcome_codes import name_of
from mbf_relay.simulation.arena import CIRCLE

CLOCK_SKEW = 0.5
"""Most time (s) by which this process's simulated clock may be ahead of the relay's."""

Drive = Callable[[PoseStamped], bool]
"""Function that drives to a pose and returns whether the robot arrived."""


def mb_relay_client() -> None:
    """Drive the tutorial's circle through move_base."""
    options = parse(circle_arguments(mb_relay_client.__doc__, "move_base", via=True))
    rospy.init_node("mb_relay_client", anonymous=True, disable_signals=True)
    if options.via == "waypoints":
        follow_circle(options)
    else:
        drive_circle(move_base_drive(options), options)


def mbf_goal_client() -> None:
    """Drive the tutorial's circle through Move Base Flex's move_base action."""
    options = parse(circle_arguments(mbf_goal_client.__doc__, "move_base_flex"))
    rospy.init_node("mbf_goal_client", anonymous=True, disable_signals=True)
    client = connect(f"{options.server}/move_base", mbf_msgs.MoveBaseAction, options.timeout)
    drive_circle(lambda pose: succeeded(run(client, mbf_msgs.MoveBaseGoal(target_pose=pose))), options)


def mbf_path_client() -> None:
    """Drive the tutorial's circle through Move Base Flex: ask for each path, then have it followed."""
    options = parse(circle_arguments(mbf_path_client.__doc__, "move_base_flex"))
    rospy.init_node("mbf_path_client", anonymous=True, disable_signals=True)
    get_path = connect(f"{options.server}/get_path", mbf_msgs.GetPathAction, options.timeout)
    exe_path = connect(f"{options.server}/exe_path", mbf_msgs.ExePathAction, options.timeout)

    def drive(pose: PoseStamped) -> bool:
        planned = run(get_path, mbf_msgs.GetPathGoal(use_start_pose=False, target_pose=pose, tolerance=0.2))
        if not succeeded(planned):
            return False
        path = planned.result.path  # type: ignore[union-attr] # succeeded
        return succeeded(run(exe_path, mbf_msgs.ExePathGoal(path=path)))

    drive_circle(drive, options)


def movebase_client() -> None:
    """Send one goal to move_base and wait until the robot is there."""
    arguments = argparse.ArgumentParser(description=movebase_client.__doc__)
    arguments.add_argument(
        "x", type=finite, nargs="?", default=0.5, help="x of the goal in `map` (m), default %(default)s")
    arguments.add_argument(
        "y", type=finite, nargs="?", default=0.0, help="y of the goal in `map` (m), default %(default)s")
    arguments.add_argument(
        "yaw", type=finite, nargs="?", default=0.0, help="heading at the goal (rad), default %(default)s")
    common_arguments(arguments, "move_base")
    options = parse(arguments)
    rospy.init_node("movebase_client", anonymous=True, disable_signals=True)
    client = connect(options.server, MoveBaseAction, options.timeout)
    reached = succeeded(run(client, MoveBaseGoal(pose_in_map(options.x, options.y, quaternion_from_yaw(options.yaw)))))
    rospy.loginfo("Goal execution done!" if reached else "The goal was not reached.")
    sys.exit(0 if reached else 1)


def drive_circle(drive: Drive, options: argparse.Namespace) -> None:
    """Drive to the circle's goals in order, print the result, and exit with 0 or 1."""
    goals = CIRCLE * options.laps
    result = True
    for number, (x, y, z, w) in enumerate(goals, 1):
        rospy.loginfo("goal %d of %d: (%.2f, %.2f)", number, len(goals), x, y)
        result = drive(pose_in_map(x, y, Quaternion(0.0, 0.0, z, w)))
        if not result:
            break
    print(f"Drove circle with result: {result}", flush=True)
    sys.exit(0 if result else 1)


def follow_circle(options: argparse.Namespace) -> None:
    """Send the circle's goals to waypoint_follower, print the result, and exit with 0 or 1."""
    from mbf_relay.msg import FollowWaypointsAction, FollowWaypointsGoal

    client = connect("follow_waypoints", FollowWaypointsAction, options.timeout)
    poses = [pose_in_map(x, y, Quaternion(0.0, 0.0, z, w)) for x, y, z, w in CIRCLE]
    goal = FollowWaypointsGoal(poses=poses, number_of_loops=options.laps - 1, stop_on_failure=True)
    result = succeeded(run(client, goal))
    print(f"Drove circle with result: {result}", flush=True)
    sys.exit(0 if result else 1)


def move_base_drive(options: argparse.Namespace) -> Drive:
    """Return a function that drives by move_base's action, or by its goal topic where there is no action server."""
    client = ActionClient(options.server, MoveBaseAction)
    on_shutdown(client.cancel_all)
    topic = GoalTopic(options.server)
    deadline, topic_since = time.monotonic() + options.timeout, None
    while not rospy.is_shutdown() and time.monotonic() < deadline:
        client.check()
        if options.via != "topic" and client.server_is_up:
            return lambda pose: succeeded(run(client, MoveBaseGoal(pose)))
        topic_since = (topic_since or time.monotonic()) if topic.is_connected else None
        if topic_since and (options.via == "topic" or options.via == "auto" and time.monotonic() - topic_since > 2.0):
            return topic.drive
        time.sleep(0.05)
    return give_up(f"no {options.server} within {options.timeout:g} s; is a relay running?")


class GoalTopic:
    """Drives by move_base_simple/goal; the result comes from the relay's ~navigation_outcome."""

    def __init__(self, server: str) -> None:
        self._goals = rospy.Publisher("move_base_simple/goal", PoseStamped, queue_size=1)
        self._outcomes: List[mbf_msgs.MoveBaseActionResult] = []
        self._subscriber = rospy.Subscriber(
            f"{server}/navigation_outcome", mbf_msgs.MoveBaseActionResult, self._outcomes.append, tcp_nodelay=True)

    @property
    def is_connected(self) -> bool:
        """Whether goals have a subscriber and outcomes a publisher."""
        return bool(self._goals.get_num_connections() and self._subscriber.get_num_connections())

    def drive(self, pose: PoseStamped) -> bool:
        """Send a pose; wait for the outcome of a goal that is not older; return whether the robot arrived."""
        pose.header.stamp = rospy.get_rostime()
        newer_than = pose.header.stamp.to_sec() - CLOCK_SKEW
        self._outcomes.clear()
        self._goals.publish(pose)
        while not rospy.is_shutdown():
            for outcome in list(self._outcomes):
                if outcome.status.goal_id.stamp.to_sec() > newer_than:
                    return succeeded(ActionEnding(outcome.status.status, outcome.status.text, outcome.result))
            if not self.is_connected:
                give_up("the relay is gone")
            time.sleep(0.05)
        sys.exit(130)


def connect(name: str, action_type: Any, timeout: float) -> ActionClient:
    """Return a client that is connected to its server; exit with 1 where there is none within `timeout` (s)."""
    client = ActionClient(name, action_type)
    on_shutdown(client.cancel_all)
    if not client.wait_for_server(timeout):
        give_up(f"no action server {client.name} within {timeout:g} s; is it running?")
    return client


def run(client: ActionClient, goal: Any) -> ActionEnding:
    """Send a goal and return how it ended; exit with 130 at shutdown."""
    ending = client.send(goal).wait()
    if ending is None:
        sys.exit(130)
    return ending


def succeeded(ending: ActionEnding) -> bool:
    """Return whether a goal succeeded; log the reason where it did not.

    Of Move Base Flex's results the outcome must be SUCCESS, too.
    """
    outcome = getattr(ending.result, "outcome", 0)
    if ending.status == GoalStatus.SUCCEEDED and outcome == 0:
        return True
    name = f", {name_of(outcome, type(ending.result))}" if outcome else ""
    message = getattr(ending.result, "message", "")
    rospy.logerr("%s%s: %s %s", name_of(ending.status, GoalStatus), name, ending.text, message)
    return False


def pose_in_map(x: float, y: float, orientation: Quaternion) -> PoseStamped:
    """Return a pose in `map`, stamped now."""
    pose = PoseStamped(pose=Pose(Point(x, y, 0.0), orientation))
    pose.header.frame_id, pose.header.stamp = "map", rospy.get_rostime()
    return pose


def circle_arguments(description: Optional[str], server: str, via: bool = False) -> argparse.ArgumentParser:
    """Return the parser of a client that drives the circle; `via` adds that option."""
    arguments = argparse.ArgumentParser(description=description)
    arguments.add_argument("--laps", type=positive, default=1, help="rounds to drive, default %(default)s")
    if via:
        arguments.add_argument("--via", choices=("auto", "action", "topic", "waypoints"), default="auto",
                               help="how to send goals; auto, the default: by the action if there is one, else by the "
                                    "topic; waypoints: all at once to waypoint_follower")
    common_arguments(arguments, server)
    return arguments


def common_arguments(arguments: argparse.ArgumentParser, server: str) -> None:
    """Add the options of all clients."""
    arguments.add_argument(
        "--server", default=server, help="name of the node that takes the goals, default %(default)s")
    arguments.add_argument("--timeout", type=not_negative, default=60.0,
                           help="seconds to wait for that node and for the ROS master, default %(default)s")


def parse(arguments: argparse.ArgumentParser, argv: Optional[Sequence[str]] = None) -> argparse.Namespace:
    """Return the options, remappings left out; waits for the ROS master for up to --timeout (s)."""
    options = arguments.parse_args(rospy.myargv(argv if argv is not None else sys.argv)[1:])
    _wait_for_master(options.timeout)
    return options


def _wait_for_master(timeout: float) -> None:
    """Wait for the ROS master; exit with 1 where there is none within `timeout` (s). rospy would wait for ever."""
    master, end, said = rosgraph.Master("/client"), time.monotonic() + timeout, False
    while not rospy.core.is_shutdown_requested():
        try:
            master.getPid()
            return
        except OSError as error:
            if time.monotonic() >= end:
                print(f"no ROS master at {master.master_uri} within {timeout:g} s ({error}); is roscore running, or a "
                      "launch file?", file=sys.stderr)
                sys.exit(1)
            if not said:
                print(f"no ROS master at {master.master_uri} ({error}); waiting for it", file=sys.stderr)
            said = True
            time.sleep(0.1)
    sys.exit(130)


def not_negative(text: str) -> float:
    """Return a text as a finite number of at least 0; for argparse."""
    value = finite(text)
    if value < 0.0:
        raise argparse.ArgumentTypeError(f"{text} is below 0")
    return value


def give_up(text: str) -> NoReturn:
    """Log an error and exit with 1."""
    rospy.logfatal("%s", text)
    sys.exit(1)
