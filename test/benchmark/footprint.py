"""What the demo's nodes take of the robot's own computer: memory, processor time and time to start.

Memory is taken half-way round the tutorial's circle, after it and after ten of them; what processes share counts once
in the proportional set size (PSS). The graph has all its nodes, once with a process started for each and once with the
navigation's forked from one; the first circle is driven at real time. The navigation is all but simulator,
robot_state_publisher and guard.
"""

from __future__ import annotations

import contextlib
import dataclasses
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from pathlib import Path
from typing import Any, Dict, Iterator, List, Mapping, Tuple

import psutil

from benchmark.metric import Metric, NotMeasurable, metric_of
from benchmark.processes import cpu_seconds, memory_mebibytes, node_pid
from mbf_relay.simulation.arena import CIRCLE

NAVIGATION = ("map_server", "amcl", "move_base_flex", "move_base")
"""move_base is the relay."""
OTHERS = ("velocity_guard", "simulator")
PARENT = "compose"
"""Who watches the navigation's nodes where they are composed; it counts with them."""
MODULES = {
    "map_server": "mbf_relay.ros.map_server.node", "amcl": "mbf_relay.ros.amcl.node",
    "move_base_flex": "mbf_relay.ros.server.node", "move_base": "mbf_relay.ros.relay.node",
}
CLIENT = Path(__file__).resolve().parents[2] / "scripts" / "mb_relay_client.py"
"""By its path, as the demo starts it: rosrun takes half a second to find it."""
IMPORTS, QUICK_IMPORTS = 5, 1
STAGES = 6
"""Libraries whose share of a node's imports is told, the longest first."""
SETTLED = 5.0
"""Wall time (s) from the first plan until a graph that has just come up only does what it does for ever."""
PATIENCE = 300.0
"""Wall time (s) after which what was asked for counts as not driven."""
CIRCLES, FACTOR = 10, 4.0
"""Circles, and simulated seconds per second of them, after which memory is taken again."""
REFERENCE = {
    "RSS": {"map_server": 17, "amcl": 22, "move_base_flex": 29, "sum": 68},
    "CPU of a circle": {"navigation": 8.5, "amcl": 2.7, "map_server": 0.5, "sum": 11.6},
    "launch to first velocity": 3.3,
}
"""The C++ stack's, built from source, on the same drive (MiB, s)."""


def metrics(quick: bool) -> Iterator[Metric]:
    """Measure imports, then a graph that is sent off at once and drives a circle, then one that drives many."""
    if shutil.which("roslaunch") is None:
        raise NotMeasurable("there is no ROS here")
    for node, module in MODULES.items():
        yield from _imports(node, module, QUICK_IMPORTS if quick else IMPORTS)
    for composed in (False, True):
        for measure in (_one_circle,) if quick else (_one_circle, _many_circles):
            with multiprocessing.get_context("spawn").Pool(1) as pool:  # rospy knows one master in a process' life
                yield from pool.apply(measure, (composed,))


def _one_circle(composed: bool) -> List[Metric]:
    """Measure a graph that is sent off at once, drives the circle and rests."""
    with _graph(composed, 1, 1.0) as (watch, began):
        first = Metric(
            "launch to first velocity", watch.wait_for_velocity() - began, "s",
            parameters={"reference": REFERENCE["launch to first velocity"]},
        )
        return [_composed(metric, composed) for metric in (first, *_drive(watch))]


def _many_circles(composed: bool) -> List[Metric]:
    """Measure what a graph holds after many circles, which it drives faster than real time."""
    with _graph(composed, CIRCLES, FACTOR) as (watch, _):
        watch.wait_for_velocity()
        pids = _pids(watch)
        watch.wait_for_goals(CIRCLES * len(CIRCLE))
        time.sleep(SETTLED)
        return [_composed(metric, composed) for metric in _memory(f"at rest after {CIRCLES} circles", pids)]


@contextlib.contextmanager
def _graph(composed: bool, laps: int, factor: float) -> Iterator[Tuple[Watch, float]]:
    """Yield who watches a demo that is sent off at once, and the wall time (s) at which it was launched."""
    from mbf_relay.ros.tools.demo_graph import DemoGraph

    launch = ["mbf_relay", "demo.launch", f"composed:={str(composed).lower()}", f"real_time_factor:={factor:g}"]
    with tempfile.TemporaryDirectory() as folder, DemoGraph(launch, folder) as graph:
        began = time.monotonic()
        graph.wait_for_parameter("/use_sim_time", 60.0)
        os.environ.update(graph.environment)
        watch = Watch()
        try:
            graph.start([str(CLIENT), "--laps", str(laps)], os.path.join(folder, "client.log"))
            yield watch, began
        finally:
            watch.close()


def _composed(metric: Metric, composed: bool) -> Metric:
    return dataclasses.replace(metric, parameters={**metric.parameters, "composed": composed})


def _imports(node: str, module: str, repeats: int) -> Iterator[Metric]:
    """Yield how long a node's imports take, and which libraries take most of it, by `python -X importtime`.

    rospy is imported first and in the nodes' own way, which leaves out what of it they do not need.
    """
    imports = f"from mbf_relay.ros.common.node import import_rospy; import_rospy(); import {module}"
    totals, shares = [], defaultdict(list)
    for _ in range(repeats):
        command = [sys.executable, "-X", "importtime", "-c", imports]
        text = subprocess.run(command, stderr=subprocess.PIPE, check=True, text=True).stderr
        of_library: Dict[str, float] = defaultdict(float)
        for line in text.splitlines()[1:]:
            if not line.startswith("import time:") or line.count("|") != 2:
                continue  # a library's own words
            own, _, name = line[len("import time:"):].split("|")
            of_library[name.strip().split(".")[0]] += 1e-3 * float(own)
        totals.append(sum(of_library.values()))
        for library, share in of_library.items():
            shares[library].append(share)
    yield metric_of("import", totals, "ms", node=node)
    longest = sorted(shares, key=lambda library: -max(shares[library]))[:STAGES]
    for library in longest:
        yield metric_of(f"import: {library}", shares[library], "ms", node=node)


def _drive(watch: Watch) -> Iterator[Metric]:
    """Yield what nodes take while the client, which has just set out, drives its circle, and afterwards."""
    pids = _pids(watch)
    started = {node: cpu_seconds(pid) for node, pid in pids.items()}
    for node in pids:
        yield Metric("CPU until the first velocity", started[node], "s", parameters={"node": node})
    total = sum(started[node] for node in pids if node not in OTHERS)
    yield Metric("CPU until the first velocity", total, "s", parameters={"node": "sum"})
    watch.wait_for_goals(len(CIRCLE) // 2)
    yield from _memory("driving", pids)
    watch.wait_for_goals(len(CIRCLE))
    used = {node: cpu_seconds(pid) - started[node] for node, pid in pids.items()}
    reference: Mapping[str, Any] = REFERENCE["CPU of a circle"]  # type: ignore[assignment]
    for node, seconds in used.items():
        yield Metric("CPU of a circle", seconds, "s", parameters=_with_reference(node, reference))
    total = sum(used[node] for node in pids if node not in OTHERS)
    yield Metric("CPU of a circle", total, "s", parameters=_with_reference("sum", reference))
    time.sleep(SETTLED)
    yield from _memory("at rest after a circle", pids)


def _pids(watch: Watch) -> Dict[str, int]:
    """Return the nodes' processes, and that of who watches them where there is one."""
    pids = {node: node_pid(f"/{node}", watch.name) for node in NAVIGATION + OTHERS}
    parent = psutil.Process(pids[NAVIGATION[0]]).parent()
    if parent is not None and any(os.path.basename(word) == PARENT for word in parent.cmdline()):
        pids[PARENT] = parent.pid
    return pids


def _memory(when: str, pids: Mapping[str, int]) -> Iterator[Metric]:
    """Yield resident, proportional and private dirty memory of each node, and their sums over the navigation."""
    taken = {node: memory_mebibytes(pid) for node, pid in pids.items()}
    for kind in ("RSS", "PSS", "private dirty"):
        reference: Mapping[str, Any] = REFERENCE.get(kind, {})  # type: ignore[assignment]
        for node in pids:
            yield Metric(f"{kind}, {when}", taken[node][kind], "MiB", parameters=_with_reference(node, reference))
        total = sum(taken[node][kind] for node in pids if node not in OTHERS)
        yield Metric(f"{kind}, {when}", total, "MiB", parameters=_with_reference("sum", reference))


def _with_reference(node: str, reference: Mapping[str, Any]) -> Dict[str, Any]:
    return {"node": node, **({"reference": reference[node]} if node in reference else {})}


class Watch:
    """Notes when the robot first moves, and counts the goals it reaches."""

    def __init__(self) -> None:
        import rospy
        from geometry_msgs.msg import Twist
        from move_base_msgs.msg import MoveBaseActionResult

        rospy.init_node("footprint_benchmark", anonymous=True, disable_signals=True)
        self.name = rospy.get_name()
        self._rospy = rospy
        self._changed = threading.Condition()
        self._moved, self._reached = 0.0, 0
        self._subscribers: List[Any] = [
            rospy.Subscriber("cmd_vel", Twist, self._take_velocity, tcp_nodelay=True),
            rospy.Subscriber("move_base/result", MoveBaseActionResult, self._take_result),
        ]

    def wait_for_velocity(self) -> float:
        """Return the wall time (s) of the first velocity that is not zero."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._moved > 0.0, PATIENCE):
                raise RuntimeError(f"waited {PATIENCE:g} s for a velocity, in vain")
            return self._moved

    def wait_for_goals(self, count: int) -> None:
        """Return once so many goals were reached."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._reached >= count, PATIENCE):
                raise RuntimeError(f"waited {PATIENCE:g} s for {count} goals, in vain")

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("measured")

    def _take_velocity(self, twist: Any) -> None:
        with self._changed:
            if not self._moved and (twist.linear.x or twist.angular.z):
                self._moved = time.monotonic()
                self._changed.notify_all()

    def _take_result(self, message: Any) -> None:
        with self._changed:
            self._reached += message.status.status == 3
            self._changed.notify_all()
