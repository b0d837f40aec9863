"""How soon the server drives and stops, how soon it plans, what it costs idle and driving, and whether it grows.

The graph is the demo's at real time, with all its nodes; this process is the client, with bare topics.
"""

from __future__ import annotations

import gc
import os
import shutil
import tempfile
import threading
import time
from typing import Any, Callable, Dict, Iterator, List, Optional, Tuple

import numpy as np
from ros_testing import wait_until

from benchmark.metric import Metric, NotMeasurable, metric_of
from benchmark.processes import cpu_seconds, node_pid, resident_bytes
from mbf_relay.simulation.arena import CIRCLE

GOALS, QUICK_GOALS = 1000, 60
WARM_UP = 100
"""Goals before memory is looked at, until every cache and arena of the server's has its size."""
PLANS, QUICK_PLANS = 200, 20
TIME, QUICK_TIME = 20.0, 4.0
"""Wall time (s) over which processor time is taken."""
SETTLED = 5.0
"""Wall time (s) from the first plan until a graph that has just come up only does what it does for ever."""
PATIENCE = 60.0
"""Wall time (s) after which an answer counts as lost, the graph's start included."""
PAUSE = 0.1
"""Longest wall time (s) between a goal and the next, so that goals come at any moment of the costmaps' and the clock's.
"""
SERVER = "move_base_flex"
SEED = 1
SUCCEEDED = 3
"""actionlib_msgs/GoalStatus'."""
VELOCITY, ZERO = "goal to first velocity", "cancel to zero velocity"
MOVES, STANDS = "a velocity", "a zero velocity"


def metrics(quick: bool) -> Iterator[Metric]:
    """Measure the server in the demo's graph."""
    if shutil.which("roslaunch") is None:
        raise NotMeasurable("there is no ROS here")
    from mbf_relay.ros.tools.demo_graph import DemoGraph

    with tempfile.TemporaryDirectory() as folder, DemoGraph(
        ["mbf_relay", "demo.launch", "command_patience:=0"], folder
    ) as graph:
        graph.wait_for_parameter("/use_sim_time", 60.0)
        os.environ.update(graph.environment)
        client = Client()
        try:
            yield from _measure(client, quick)
        finally:
            client.close()


def _measure(client: Client, quick: bool) -> Iterator[Metric]:
    goals, plans, seconds = (QUICK_GOALS, QUICK_PLANS, QUICK_TIME) if quick else (GOALS, PLANS, TIME)
    client.wait_for_graph()
    time.sleep(SETTLED)
    pid = node_pid(f"/{SERVER}", client.name)
    yield _share("idle server", pid, seconds, lambda: time.sleep(seconds))
    yield Metric("goal to first velocity, first goal of all", client.touch_and_go(1)[VELOCITY][0], "ms")
    client.touch_and_go(20 if quick else WARM_UP)
    memory = resident_bytes(pid)
    taken = client.touch_and_go(goals)
    grown = resident_bytes(pid) - memory
    taken["get_path, goal to result"] = [client.plan() for _ in range(plans)]
    for name, times in taken.items():
        yield metric_of(name, times, "ms", goals=len(times))
        yield Metric(f"{name}, longest", max(times), "ms", repeats=len(times))
    yield Metric("memory the server grew by", grown / 2.0 ** 20, "MiB", parameters={"goals": goals})
    yield _share("driving server", pid, seconds, lambda: client.drive_for(seconds))


def _share(name: str, pid: int, seconds: float, do: Callable[[], None]) -> Metric:
    """Return the share of a core that a process uses while something is done."""
    used, began = cpu_seconds(pid), time.monotonic()
    do()
    share = 100.0 * (cpu_seconds(pid) - used) / (time.monotonic() - began)
    return Metric(f"{name}, share of one core", share, "%", parameters={"time_s": seconds})


class Client:
    """Sends goals to the server and notes when what it waits for arrives."""

    def __init__(self) -> None:
        import rospy
        from actionlib_msgs.msg import GoalID
        from geometry_msgs.msg import Twist
        from mbf_msgs import msg

        rospy.init_node("server_benchmark", anonymous=True, disable_signals=True)
        self.name = rospy.get_name()
        self._rospy, self._goal_id, self._msg = rospy, GoalID, msg
        self._rng = np.random.default_rng(SEED)
        self._arrived = threading.Condition()
        self._arrivals: Dict[str, Tuple[float, Any]] = {}  # the first of each kind since it was last asked for
        self._number = 0

        def publish(name: str, kind: Any) -> Any:
            return rospy.Publisher(f"{SERVER}/{name}", kind, queue_size=50, tcp_nodelay=True)

        def listen(name: str, kind: Any, take: Callable[[Any], None]) -> Any:
            return rospy.Subscriber(name, kind, take, tcp_nodelay=True)

        self._drives = publish("move_base/goal", msg.MoveBaseActionGoal)
        self._plans, self._cancels = (
            publish("get_path/goal", msg.GetPathActionGoal),
            publish("move_base/cancel", GoalID),
        )
        self._links = [
            self._drives, self._plans, self._cancels, listen("cmd_vel", Twist, self._take_velocity),
            listen(f"{SERVER}/move_base/result", msg.MoveBaseActionResult, self._take_result),
            listen(f"{SERVER}/get_path/result", msg.GetPathActionResult, self._take_result),
        ]

    def wait_for_graph(self) -> None:
        """Return once the server finds paths, with this process' own garbage out of the way."""
        wait_until(lambda: all(link.get_num_connections() for link in self._links), "the server's topics", PATIENCE)
        wait_until(lambda: self._plan()[1].status.status == SUCCEEDED, "a server that finds paths", PATIENCE, 0.1)
        gc.collect()
        gc.freeze()

    def touch_and_go(self, goals: int) -> Dict[str, List[float]]:
        """Have the server set out for goals of the circle, each cancelled once the robot moves.

        Returns:
            The times (ms) from goals to velocities and from cancels to zeros.
        """
        taken: Dict[str, List[float]] = {VELOCITY: [], ZERO: []}
        for _ in range(goals):
            goal = self._new(self._msg.MoveBaseActionGoal, self._rng.integers(len(CIRCLE)))
            taken[VELOCITY].append(self._ask(self._drives, goal, MOVES)[0])
            taken[ZERO].append(self._ask(self._cancels, goal.goal_id, STANDS)[0])
            self._wait(goal.goal_id.id)
            time.sleep(self._rng.uniform(0.0, PAUSE))
        return taken

    def plan(self) -> float:
        """Return the time (ms) from a goal of get_path to its result."""
        took, result = self._plan()
        if result.status.status != SUCCEEDED:
            raise RuntimeError(f"no path: {result.status.text}")
        time.sleep(self._rng.uniform(0.0, PAUSE))
        return took

    def drive_for(self, seconds: float) -> None:
        """Drive the circle for some wall time, then stop."""
        end, place = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            goal = self._new(self._msg.MoveBaseActionGoal, place)
            place = (place + 1) % len(CIRCLE)
            self._drives.publish(goal)
            if self._wait(goal.goal_id.id, end - time.monotonic()) is None:
                self._ask(self._cancels, goal.goal_id, STANDS)

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("measured")

    def _plan(self) -> Tuple[float, Any]:
        goal = self._new(self._msg.GetPathActionGoal, self._rng.integers(len(CIRCLE)))
        return self._ask(self._plans, goal, goal.goal_id.id)

    def _new(self, kind: Any, place: int) -> Any:
        """Return an action's goal at a place of the circle."""
        self._number += 1
        goal = kind(goal_id=self._goal_id(id=f"goal-{self._number}"))
        pose = goal.goal.target_pose
        pose.header.frame_id = "map"
        pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.z, pose.pose.orientation.w = CIRCLE[place]
        return goal

    def _ask(self, publisher: Any, message: Any, answer: str) -> Tuple[float, Any]:
        """Publish and wait for what answers it; return the time (ms) between, and the answer."""
        with self._arrived:
            self._arrivals.pop(answer, None)
        sent = time.monotonic()
        publisher.publish(message)
        found = self._wait(answer)
        if found is None:
            raise RuntimeError(f"no answer '{answer}' within {PATIENCE:g} s to:\n{message}")
        return 1e3 * (found[0] - sent), found[1]

    def _wait(self, answer: str, patience: float = PATIENCE) -> Optional[Tuple[float, Any]]:
        """Return when an answer arrived and what it says, and forget it; None where it does not come."""
        with self._arrived:
            self._arrived.wait_for(lambda: answer in self._arrivals, max(0.0, patience))
            return self._arrivals.pop(answer, None)

    def _take_velocity(self, twist: Any) -> None:
        self._note(MOVES if twist.linear.x or twist.linear.y or twist.angular.z else STANDS, twist)

    def _take_result(self, message: Any) -> None:
        self._note(message.status.goal_id.id, message)

    def _note(self, answer: str, message: Any) -> None:
        now = time.monotonic()
        with self._arrived:
            self._arrivals.setdefault(answer, (now, message))
            self._arrived.notify_all()
