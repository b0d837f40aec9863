"""move_base in one process beside relay and server in two: how soon a client's goal moves the robot, and the memory.

The graphs are alike but for that, run at real time one after the other and again in the other order, so that what the
machine does meanwhile falls on both. This process is the client, with bare topics.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import tempfile
import threading
import time
from collections import defaultdict
from typing import Any, Dict, Iterator, List, Tuple

import numpy as np

from benchmark.metric import Metric, NotMeasurable, metric_of
from benchmark.processes import memory_mebibytes, node_pid
from mbf_relay.simulation.arena import CIRCLE

ROUNDS, QUICK_ROUNDS = 4, 2
"""Graphs of each kind."""
GOALS, QUICK_GOALS = 200, 40
WARM_UP = 20
PATIENCE = 60.0
"""Wall time (s) after which an answer counts as lost, the graph's start included."""
PAUSE = 0.1
"""Longest wall time (s) between a goal's end and the next, so that goals come at any moment of a control cycle."""
SEED = 1
VELOCITY, ZERO = "goal to first velocity", "cancel to zero velocity"
NODES = {"one": ("move_base",), "two": ("move_base", "move_base_flex")}
"""By the number of processes."""
LAUNCH = """<launch>
  <include file="$(find mbf_relay)/launch/simulator.launch"/>
  <include file="$(find mbf_relay)/launch/localization.launch"/>
  <include file="$(find mbf_relay)/launch/move_base_flex.launch" if="{two}"/>
  <include file="$(find mbf_relay)/launch/move_base_relay.launch" if="{two}"/>
  <node pkg="mbf_relay" type="move_base" name="move_base" unless="{two}">
    <rosparam command="load" file="$(find mbf_relay)/config/move_base_flex.yaml"/>
    <param name="base_local_planner" value="dwa_local_planner/DWAPlannerROS"/>
  </node>
</launch>
"""


def metrics(quick: bool) -> Iterator[Metric]:
    """Measure both kinds of graph in turn."""
    if shutil.which("roslaunch") is None:
        raise NotMeasurable("there is no ROS here")
    rounds, goals = (QUICK_ROUNDS, QUICK_GOALS) if quick else (ROUNDS, GOALS)
    taken: Dict[Tuple[str, str, str], List[float]] = defaultdict(list)
    for index in range(rounds):
        for kind in sorted(NODES, reverse=bool(index % 2)):
            # each in a process of its own, since rospy knows one master in its life
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                for (name, unit), values in pool.apply(_graph, (kind, goals)).items():
                    taken[kind, name, unit].extend(values)
    for (kind, name, unit), values in taken.items():
        yield metric_of(name, values, unit, processes=kind)


def _graph(kind: str, goals: int) -> Dict[Tuple[str, str], List[float]]:
    """Return the times and the memory, summed over the nodes, of one graph: by metric and unit."""
    from mbf_relay.ros.tools.demo_graph import DemoGraph

    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "graph.launch")
        with open(path, "w", encoding="utf-8") as stream:
            stream.write(LAUNCH.format(two=str(kind == "two").lower()))
        with DemoGraph([path], folder) as graph:
            graph.wait_for_parameter("/use_sim_time", PATIENCE)
            os.environ.update(graph.environment)
            client = Client()
            client.wait_for_graph()
            client.touch_and_go(WARM_UP)
            taken = {(name, "ms"): times for name, times in client.touch_and_go(goals).items()}
            memory = [memory_mebibytes(node_pid(f"/{node}", client.name)) for node in NODES[kind]]
            client.close()
    for name in memory[0]:
        taken[name, "MiB"] = [sum(of_node[name] for of_node in memory)]
    return taken


class Client:
    """Sends goals to move_base and cancels each when the robot moves."""

    def __init__(self) -> None:
        import rospy
        from actionlib_msgs.msg import GoalID
        from geometry_msgs.msg import Twist
        from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult

        rospy.init_node("one_process_benchmark", anonymous=True, disable_signals=True)
        self.name = rospy.get_name()
        self._rospy, self._goal = rospy, MoveBaseActionGoal
        self._rng = np.random.default_rng(SEED)
        self._changed = threading.Condition()
        self._moves, self._at, self._ended = False, 0.0, ""
        self._goals = rospy.Publisher("move_base/goal", MoveBaseActionGoal, queue_size=10, tcp_nodelay=True)
        self._cancels = rospy.Publisher("move_base/cancel", GoalID, queue_size=10, tcp_nodelay=True)
        self._links: List[Any] = [
            self._goals, self._cancels,
            rospy.Subscriber("cmd_vel", Twist, self._take_velocity, tcp_nodelay=True),
            rospy.Subscriber("move_base/result", MoveBaseActionResult, self._take_result, tcp_nodelay=True),
        ]

    def wait_for_graph(self) -> None:
        """Return once a goal moves the robot, and then a cancel stops it."""
        end = time.monotonic() + PATIENCE
        while not all(link.get_num_connections() for link in self._links):
            if time.monotonic() > end:
                raise RuntimeError(f"waited {PATIENCE:g} s for move_base, in vain")
            time.sleep(0.1)
        self.touch_and_go(1)

    def touch_and_go(self, goals: int) -> Dict[str, List[float]]:
        """Return the times (ms) from goals to velocities and from cancels to zeros."""
        taken: Dict[str, List[float]] = {VELOCITY: [], ZERO: []}
        for _ in range(goals):
            goal = self._goal()
            goal.goal_id.id = f"goal-{time.monotonic()}"
            pose = goal.goal.target_pose
            pose.header.frame_id = "map"
            pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.z, pose.pose.orientation.w = CIRCLE[
                self._rng.integers(len(CIRCLE))]
            taken[VELOCITY].append(self._ask(self._goals, goal, moves=True))
            taken[ZERO].append(self._ask(self._cancels, goal.goal_id, moves=False))
            self._wait(lambda identity=goal.goal_id.id: self._ended == identity, "the goal's end")
            time.sleep(self._rng.uniform(0.0, PAUSE))
        return taken

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("measured")

    def _ask(self, publisher: Any, message: Any, moves: bool) -> float:
        """Publish and return the time (ms) until the commanded velocity is zero no longer, or again."""
        sent = time.monotonic()
        publisher.publish(message)
        self._wait(lambda: self._moves == moves, "a velocity" if moves else "a zero velocity")
        return 1e3 * (self._at - sent)

    def _wait(self, condition: Any, what: str) -> None:
        with self._changed:
            if not self._changed.wait_for(condition, PATIENCE):
                raise RuntimeError(f"waited {PATIENCE:g} s for {what}, in vain")

    def _take_velocity(self, twist: Any) -> None:
        moves = bool(twist.linear.x or twist.linear.y or twist.angular.z)
        with self._changed:
            if moves != self._moves:
                self._moves, self._at = moves, time.monotonic()
                self._changed.notify_all()

    def _take_result(self, message: Any) -> None:
        with self._changed:
            self._ended = message.status.goal_id.id
            self._changed.notify_all()
