"""move_base in one process beside relay and server in two: how soon a client's goal moves the robot, and the memory.

The graphs are alike but for that, run at real time one after the other and again in the other order, so that what the
machine does meanwhile falls on both. This process is the client, with bare topics.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import tempfile
from collections import defaultdict
from typing import Dict, Iterator, List, Tuple

from benchmark.circle_client import PATIENCE, CircleClient
from benchmark.metric import Metric, NotMeasurable, metric_of
from benchmark.processes import memory_mebibytes, node_pid

ROUNDS, QUICK_ROUNDS = 4, 2
"""Graphs of each kind."""
GOALS, QUICK_GOALS = 200, 40
WARM_UP = 20
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


class Client(CircleClient):
    """A client of move_base."""

    def __init__(self) -> None:
        from move_base_msgs.msg import MoveBaseActionGoal, MoveBaseActionResult

        super().__init__("one_process_benchmark", "move_base", MoveBaseActionGoal, MoveBaseActionResult)

    def wait_for_graph(self) -> None:
        """Return once a goal moves the robot, and then a cancel stops it."""
        self.wait_for_links()
        self.touch_and_go(1)
        self.put_garbage_away()
