"""How long the relay holds a goal, a feedback and a cancel, what it costs while idle, and whether it grows.

This process is client and server at once, with bare topics, so that all it waits for is the relay.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
import time
from typing import Any, Dict, Iterator, List, Tuple

import numpy as np
from ros_testing import wait_until

from benchmark.metric import Metric, NotMeasurable, metric_of
from benchmark.processes import cpu_seconds, node_pid, resident_bytes
from mbf_relay.ros.common.actions.goal_lease import MARK

GOALS, QUICK_GOALS = 10_000, 500
WARM_UP = 3_000
"""Goals before the measurement, until every list, cache and arena of the relay's has its size."""
IDLE_TIME = 10.0
WAIT = 10.0
"""Wall time (s) after which a message counts as lost."""
SETTLED = 1.0
"""Wall time (s) from the last connection until the relay only does what it does for ever."""
CLIENT, SERVER = "move_base", "move_base_flex/move_base"


def metrics(quick: bool) -> Iterator[Metric]:
    """Measure the relay between two ends in this process."""
    if shutil.which("roslaunch") is None:
        raise NotMeasurable("there is no ROS here")
    from mbf_relay.ros.tools.demo_graph import DemoGraph

    goals, idle_time = (QUICK_GOALS, 2.0) if quick else (GOALS, IDLE_TIME)
    with tempfile.TemporaryDirectory() as folder, DemoGraph(["mbf_relay", "move_base_relay.launch"], folder) as graph:
        graph.wait_for_parameter("/move_base/server", 60.0)
        os.environ.update(graph.environment)
        ends = Ends()
        relay = ends.relay_pid()
        used = cpu_seconds(relay)
        time.sleep(idle_time)
        used = cpu_seconds(relay) - used
        ends.exchange(100 if quick else WARM_UP)
        memory = resident_bytes(relay)
        samples = ends.exchange(goals)
        grown = resident_bytes(relay) - memory
        ends.close()
    for name, times in samples.items():
        yield metric_of(f"{name} through the relay", times, "ms", goals=goals)
        yield Metric(f"{name} through the relay, 99 %", float(np.percentile(times, 99)), "ms", repeats=len(times))
    yield Metric("idle relay, share of one core", 100.0 * used / idle_time, "%", parameters={"time_s": idle_time})
    yield Metric("memory the relay grew by", grown / 2.0 ** 20, "MiB", parameters={"goals": goals})


class Ends:
    """A client of move_base and a Move Base Flex server, in one."""

    def __init__(self) -> None:
        import rospy
        from actionlib_msgs.msg import GoalID, GoalStatus, GoalStatusArray
        from mbf_msgs import msg as back
        from move_base_msgs import msg as front

        rospy.init_node("relay_benchmark", anonymous=True, disable_signals=True)
        self._rospy, self._front, self._back = rospy, front, back
        self._goal_id, self._goal_status, self._status_array = GoalID, GoalStatus, GoalStatusArray
        self._arrivals: Dict[str, Tuple[float, Any]] = {}
        self._arrived = threading.Condition()
        self._running: List[Any] = []
        self._number = 0
        self._publishers = {
            name: rospy.Publisher(name, kind, queue_size=50, tcp_nodelay=True)
            for name, kind in (
                (f"{CLIENT}/goal", front.MoveBaseActionGoal), (f"{CLIENT}/cancel", GoalID),
                (f"{SERVER}/status", GoalStatusArray), (f"{SERVER}/feedback", back.MoveBaseActionFeedback),
                (f"{SERVER}/result", back.MoveBaseActionResult),
            )
        }
        self._subscribers = [
            rospy.Subscriber(name, kind, self._note, callback_args=name, tcp_nodelay=True)
            for name, kind in (
                (f"{SERVER}/goal", back.MoveBaseActionGoal), (f"{SERVER}/cancel", GoalID),
                (f"{CLIENT}/feedback", front.MoveBaseActionFeedback), (f"{CLIENT}/result", front.MoveBaseActionResult),
            )
        ]
        threading.Thread(target=self._keep_saying_status, daemon=True).start()
        links = [*self._publishers.values(), *self._subscribers]
        wait_until(lambda: all(link.get_num_connections() for link in links), "the relay's connections", WAIT)
        time.sleep(SETTLED)

    def exchange(self, goals: int) -> Dict[str, List[float]]:
        """Send goals, each answered by feedback, cancelled and ended; leased, so that they are spoken of at once.

        Returns:
            The times (ms) the relay took for goals, feedback, cancels and results.
        """
        samples: Dict[str, List[float]] = {"goal": [], "feedback": [], "cancel": [], "result": []}
        for _ in range(goals):
            self._number += 1
            goal = self._front.MoveBaseActionGoal(goal_id=self._goal_id(id=f"goal-{self._number}{MARK}"))
            goal.goal.target_pose.header.frame_id, goal.goal.target_pose.pose.orientation.w = "map", 1.0
            took, arrived = self._pass(f"{CLIENT}/goal", goal, f"{SERVER}/goal")
            samples["goal"].append(took)
            status = self._goal_status(goal_id=arrived.goal_id, status=self._goal_status.ACTIVE)
            self._running = [status]
            self._publishers[f"{SERVER}/status"].publish(self._status_array(status_list=self._running))
            feedback = self._back.MoveBaseActionFeedback(status=status)
            samples["feedback"].append(self._pass(f"{SERVER}/feedback", feedback, f"{CLIENT}/feedback")[0])
            samples["cancel"].append(self._pass(f"{CLIENT}/cancel", goal.goal_id, f"{SERVER}/cancel")[0])
            status = self._goal_status(goal_id=arrived.goal_id, status=self._goal_status.PREEMPTED)
            self._running = []
            result = self._back.MoveBaseActionResult(status=status)
            samples["result"].append(self._pass(f"{SERVER}/result", result, f"{CLIENT}/result")[0])
        return samples

    def relay_pid(self) -> int:
        """Return the relay's process."""
        return node_pid("/move_base", self._rospy.get_name())

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("measured")

    def _pass(self, source: str, message: Any, target: str) -> Tuple[float, Any]:
        """Publish on one side and wait for what arrives on the other; return the time (ms) between, and the arrival."""
        with self._arrived:
            self._arrivals.pop(target, None)
        sent = time.monotonic()
        self._publishers[source].publish(message)
        with self._arrived:
            if not self._arrived.wait_for(lambda: target in self._arrivals, WAIT):
                raise RuntimeError(f"nothing came on {target} within {WAIT:g} s of a message on {source}")
            arrived, message = self._arrivals[target]
        return 1e3 * (arrived - sent), message

    def _note(self, message: Any, name: str) -> None:
        now = time.monotonic()
        with self._arrived:
            self._arrivals[name] = (now, message)
            self._arrived.notify_all()

    def _keep_saying_status(self) -> None:
        while not self._rospy.is_shutdown():
            self._publishers[f"{SERVER}/status"].publish(self._status_array(status_list=list(self._running)))
            time.sleep(0.2)
