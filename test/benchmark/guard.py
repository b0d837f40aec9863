"""How long the velocity guard holds a velocity, and what it costs while the robot drives.

Once with the simulator at real time, whose clock the guard reads sixty times a second, and once as on a robot, by the
wall clock, whose drivers a thread stands in for. This process is who drives, with the server's ten velocities a second.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import shutil
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, Dict, Iterator, List, Optional

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
CLOCKS = ("simulated", "wall")
ODOMETRY_RATE, SCANS_EVERY, BEAMS, RANGE = 30.0, 6, 360, 1.5
"""Of the drivers on the wall clock: odometry (Hz), how many of it to a scan, its beams, and about their length (m)."""


def metrics(quick: bool) -> Iterator[Metric]:
    """Measure the guard between this process and the wheels."""
    if shutil.which("roslaunch") is None:
        raise NotMeasurable("there is no ROS here")
    for clock in CLOCKS:
        with multiprocessing.get_context("spawn").Pool(1) as pool:  # of one master a process can be part
            yield from pool.apply(_of_graph, (clock, QUICK_TIME if quick else TIME))


def _of_graph(clock: str, seconds: float) -> List[Metric]:
    """Measure with one of CLOCKS for so long (wall time)."""
    from mbf_relay.ros.tools.demo_graph import DemoGraph

    names = ("simulator.launch", "velocity_guard.launch") if clock == "simulated" else ("velocity_guard.launch",)
    with tempfile.TemporaryDirectory() as folder, DemoGraph([str(LAUNCH / name) for name in names], folder) as graph:
        graph.wait_for_parameter("/velocity_guard/scan_timeout", PATIENCE)
        os.environ.update(graph.environment)
        driver = Driver(with_sensors=clock == "wall")
        guard = driver.guard_pid()
        driver.drive_for(WARM_UP)
        used, began = cpu_seconds(guard), time.monotonic()
        held = driver.drive_for(seconds)
        share = 100.0 * (cpu_seconds(guard) - used) / (time.monotonic() - began)
        driver.close()
    passed = [took for took in held if math.isfinite(took)]
    return [
        Metric("velocities held back", float(len(held) - len(passed)), repeats=len(held), parameters={"clock": clock}),
        metric_of("velocity through the guard", passed, "ms", rate_hz=1.0 / PERIOD, clock=clock),
        Metric("velocity through the guard, 99 %", float(np.percentile(passed, 99)), "ms", repeats=len(passed),
               parameters={"clock": clock}),
        Metric("driving guard, share of one core", share, "%", parameters={"time_s": seconds, "clock": clock}),
    ]


class Driver:
    """Publishes velocities before the guard and notes when they come out behind it.

    Args:
        with_sensors: Whether it publishes what a robot's drivers do, too.
    """

    def __init__(self, with_sensors: bool) -> None:
        import rospy
        from geometry_msgs.msg import Twist

        rospy.init_node("guard_benchmark", anonymous=True, disable_signals=True)
        self._rospy, self._twist = rospy, Twist
        self._passed: Dict[float, float] = {}  # when a velocity came out (s, wall), by how fast it turns (rad/s)
        self._number = 0
        self._sensors: Optional[Sensors] = Sensors() if with_sensors else None
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
        if self._sensors is not None:
            self._sensors.close()
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


class Sensors:
    """Publishes odometry, scans and where the lidar sits, as the drivers of a robot that drives a small circle do."""

    def __init__(self) -> None:
        import rospy
        from geometry_msgs.msg import TransformStamped
        from nav_msgs.msg import Odometry
        from sensor_msgs.msg import LaserScan
        from tf2_msgs.msg import TFMessage

        self._now = rospy.get_rostime
        self._odometry = Odometry()
        self._odometry.header.frame_id, self._odometry.child_frame_id = "odom", "base_footprint"
        self._odometry.twist.twist.linear.x, self._odometry.twist.twist.angular.z = SPEED, TURN
        self._scan = LaserScan(
            angle_increment=2.0 * math.pi / BEAMS, angle_max=2.0 * math.pi * (BEAMS - 1) / BEAMS, range_min=0.12,
            range_max=3.5)
        self._scan.header.frame_id = "base_scan"
        self._odom = rospy.Publisher("odom", Odometry, queue_size=1, tcp_nodelay=True)
        self._scans = rospy.Publisher("scan", LaserScan, queue_size=1, tcp_nodelay=True)
        self._static = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        place = TransformStamped(child_frame_id="base_scan")
        place.header.frame_id, place.transform.rotation.w = "base_footprint", 1.0
        self._static.publish(TFMessage([place]))
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        count, began = 0, time.monotonic()
        while not self._ended.wait(max(0.0, began + count / ODOMETRY_RATE - time.monotonic())):
            turned = TURN * count / ODOMETRY_RATE
            self._odometry.header.stamp = self._now()
            pose = self._odometry.pose.pose
            pose.position.x, pose.position.y = SPEED / TURN * math.sin(turned), SPEED / TURN * (1.0 - math.cos(turned))
            pose.orientation.z, pose.orientation.w = math.sin(0.5 * turned), math.cos(0.5 * turned)
            self._odom.publish(self._odometry)
            if count % SCANS_EVERY == 0:
                self._scan.header.stamp = self._now()
                self._scan.ranges = [RANGE + 0.01 * ((count + beam) % 7) for beam in range(BEAMS)]
                self._scans.publish(self._scan)
            count += 1
