"""How long the velocity guard holds a velocity, and what it costs while the robot drives.

The graph is simulator and guard at real time; this process is who drives, with the server's ten velocities a second.
"""

from __future__ import annotations

import math
import os
import shutil
import tempfile
import time
from pathlib import Path
from typing import Any, Dict, Iterator, List

import numpy as np
from ros_testing import wait_until

from benchmark.metric import Metric, NotMeasurable, metric_of
from benchmark.processes import cpu_seconds, node_pid

LAUNCH = Path(__file__).resolve().parents[2] / "launch"
TIME, QUICK_TIME = 60.0, 5.0
"""Wall time (s) of driving."""
WARM_UP = 5.0
"""Wall time (s) before, until all is loaded and the guard has learnt how late the wheels are."""
PERIOD = 0.1
"""Wall time (s) from velocity to velocity, DWA's."""
SPEED, TURN = 0.05, 1.0
"""Of the driving (m/s, rad/s): a circle of 5 cm, for which there is always room."""
PATIENCE = 30.0
"""Wall time (s) in which the graph must come up."""


def metrics(quick: bool) -> Iterator[Metric]:
    """Measure the guard between this process and the simulator."""
    if shutil.which("roslaunch") is None:
        raise NotMeasurable("there is no ROS here")
    from mbf_relay.ros.tools.demo_graph import DemoGraph

    seconds = QUICK_TIME if quick else TIME
    files = [str(LAUNCH / "simulator.launch"), str(LAUNCH / "velocity_guard.launch")]
    with tempfile.TemporaryDirectory() as folder, DemoGraph(files, folder) as graph:
        graph.wait_for_parameter("/use_sim_time", PATIENCE)
        os.environ.update(graph.environment)
        driver = Driver()
        guard = driver.guard_pid()
        driver.drive_for(WARM_UP)
        used, began = cpu_seconds(guard), time.monotonic()
        held = driver.drive_for(seconds)
        share = 100.0 * (cpu_seconds(guard) - used) / (time.monotonic() - began)
        driver.close()
    passed = [took for took in held if math.isfinite(took)]
    yield Metric("velocities held back", float(len(held) - len(passed)), repeats=len(held))
    yield metric_of("velocity through the guard", passed, "ms", rate_hz=1.0 / PERIOD)
    yield Metric("velocity through the guard, 99 %", float(np.percentile(passed, 99)), "ms", repeats=len(passed))
    yield Metric("driving guard, share of one core", share, "%", parameters={"time_s": seconds})


class Driver:
    """Publishes velocities before the guard and notes when they come out behind it."""

    def __init__(self) -> None:
        import rospy
        from geometry_msgs.msg import Twist

        rospy.init_node("guard_benchmark", anonymous=True, disable_signals=True)
        self._rospy, self._twist = rospy, Twist
        self._passed: Dict[float, float] = {}  # when a velocity came out (s, wall), by how fast it turns (rad/s)
        self._number = 0
        self._velocities = rospy.Publisher("cmd_vel_raw", Twist, queue_size=1, tcp_nodelay=True)
        heard = rospy.Subscriber("cmd_vel", Twist, self._note, tcp_nodelay=True)
        wait_until(lambda: self._velocities.get_num_connections() and heard.get_num_connections(), "a guard", PATIENCE)
        wait_until(self._passes, "a guard that lets velocities pass", PATIENCE, PERIOD)

    def drive_for(self, seconds: float) -> List[float]:
        """Drive for some wall time.

        Returns:
            The time (ms) that each velocity took through the guard; infinite for one that did not pass as it was.
        """
        sent: Dict[float, float] = {}
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            began = time.monotonic()
            sent[self._send()] = began
            time.sleep(PERIOD)
        return [1e3 * (self._passed.get(turn, math.inf) - began) for turn, began in sent.items()]

    def guard_pid(self) -> int:
        """Return the guard's process."""
        return node_pid("/velocity_guard", self._rospy.get_name())

    def close(self) -> None:
        """Stop the robot and leave ROS."""
        self._velocities.publish(self._twist())
        self._rospy.signal_shutdown("measured")

    def _send(self) -> float:
        """Publish a velocity that there was not before; return how fast it turns (rad/s)."""
        self._number += 1
        twist = self._twist()
        twist.linear.x, twist.angular.z = SPEED, TURN + 1e-6 * self._number
        self._velocities.publish(twist)
        return float(twist.angular.z)

    def _passes(self) -> bool:
        self._send()
        return bool(self._passed)

    def _note(self, twist: Any) -> None:
        self._passed.setdefault(float(twist.angular.z), time.monotonic())
