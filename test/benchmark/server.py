"""How soon the server drives and stops, how soon it plans, what it costs idle and driving, and whether it grows.

The graph is the demo's at real time, with all its nodes; this process is the client, with bare topics.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from typing import Any, Callable, Iterator, Tuple

from ros_testing import wait_until

from benchmark.circle_client import PATIENCE, STANDS, VELOCITY, CircleClient
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
SERVER = "move_base_flex"
SUCCEEDED = 3
"""actionlib_msgs/GoalStatus'."""


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


class Client(CircleClient):
    """Drives and plans by the server's own actions."""

    def __init__(self) -> None:
        from mbf_msgs import msg

        super().__init__(
            "server_benchmark", f"{SERVER}/move_base", msg.MoveBaseActionGoal, msg.MoveBaseActionResult)
        self._path_goal = msg.GetPathActionGoal
        self._plans = self.publish(f"{SERVER}/get_path/goal", msg.GetPathActionGoal)
        self.listen(f"{SERVER}/get_path/result", msg.GetPathActionResult, self.take_result)

    def wait_for_graph(self) -> None:
        """Return once the server finds paths, with this process' own garbage out of the way."""
        self.wait_for_links()
        wait_until(lambda: self._plan()[1].status.status == SUCCEEDED, "a server that finds paths", PATIENCE, 0.1)
        self.put_garbage_away()

    def plan(self) -> float:
        """Return the time (ms) from a goal of get_path to its result."""
        took, result = self._plan()
        if result.status.status != SUCCEEDED:
            raise RuntimeError(f"no path: {result.status.text}")
        self.pause()
        return took

    def drive_for(self, seconds: float) -> None:
        """Drive the circle for some wall time, then stop."""
        end, place = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            goal = self.new_goal(place)
            place = (place + 1) % len(CIRCLE)
            self.drives.publish(goal)
            if self.wait(goal.goal_id.id, end - time.monotonic()) is None:
                self.ask(self.cancels, goal.goal_id, STANDS)

    def _plan(self) -> Tuple[float, Any]:
        goal = self.new_goal(kind=self._path_goal)
        return self.ask(self._plans, goal, goal.goal_id.id)
