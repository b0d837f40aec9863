"""What seeing the robot in a browser costs: time from /tf to the pixel, frames, bytes, processor, memory, time to stop.

All of it beside the demo, whose robot drives its circle meanwhile: simulator, navigation, node and browser share one
machine.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from typing import Any, Callable, Iterator, List, Tuple

import numpy as np
from tally import LONG

from benchmark.metric import Metric, NotMeasurable, metric_of
from benchmark.processes import cpu_seconds, node_pid, resident_bytes

PATIENCE = 90.0
PLACES = ((-0.5, 0.0), (0.5, 0.0))
"""Where the robot of the latency measurement stands in turn (m), the second within sight of the watch below."""
WATCH = """
const [x, y] = arguments, canvas = document.getElementById('canvas'), context = canvas.getContext('2d');
const ratio = canvas.width / canvas.clientWidth;
window.seen = [];
let before = null;
const look = () => {
  const [column, row] = page.camera.toScreen(x, y);
  const pixel = context.getImageData(Math.round(column * ratio), Math.round(row * ratio), 1, 1).data;
  const there = pixel[2] > pixel[0] + 80;
  if (before !== null && there !== before) window.seen.push([performance.timeOrigin + performance.now(), there]);
  before = there;
  requestAnimationFrame(look);
};
look();
"""
"""Notes when the robot's blue comes to, and leaves, one place of the drawn map."""
BUSY = "const draw = () => { page.redraw(); requestAnimationFrame(draw); }; draw();"
"""Has the page draw as often as it can."""


def metrics(quick: bool) -> Iterator[Metric]:
    """Measure the node beside the demo."""
    from web_page import missing

    if shutil.which("roslaunch") is None or missing():
        raise NotMeasurable(missing() or "there is no ROS here")
    from mbf_relay.ros.tools.demo_graph import DemoGraph, free_port

    seconds = 5.0 if quick else 30.0
    with tempfile.TemporaryDirectory() as folder:
        port = free_port()
        with DemoGraph(["mbf_relay", "demo.launch", "web:=true", f"web_port:={port}"], folder) as graph:
            graph.wait_for_parameter("/web_view/port", PATIENCE)
            os.environ.update(graph.environment)
            here = Bench(port)
            laps = graph.start(
                ["rosrun", "mbf_relay", "mb_relay_client.py", "--laps", "1000"], os.path.join(folder, "laps.log")
            )
            here.wait_until_driving()
            yield from here.costs(seconds)
            yield from here.frames(seconds)
            yield from here.growth(0.5 if quick else 60.0 if LONG else 5.0)
            probe_port = free_port()
            graph.start(
                ["rosrun", "mbf_relay", "web_view", "__ns:=/probe", f"_port:={probe_port}", "_base_frame:=probe_base"],
                os.path.join(folder, "probe.log"))
            yield from here.latency(probe_port, 100 if quick else 600)
            laps.terminate()
            yield from here.stopping(5 if quick else 50)
            here.close()


class Bench:
    """This process as browsers, as a robot that only moves, and as wheels."""

    def __init__(self, port: int) -> None:
        import rospy
        from ros_testing import wait_until
        from web_client import WebClient

        rospy.init_node("web_benchmark", disable_signals=True)
        self._rospy, self._client, self._port, self._wait_until = rospy, WebClient, port, wait_until
        wait_until(lambda: answers(port), "web_view to serve", PATIENCE)
        self._pid = node_pid("/web_view", rospy.get_name())

    def wait_until_driving(self) -> None:
        """Return once the robot drives, with nobody connected any more."""
        client = self._client(self._port)
        client.layer("state", lambda told: told["goal"]["driving"], "of a robot that drives", PATIENCE)
        client.close()

    def costs(self, seconds: float) -> Iterator[Metric]:
        """Measure processor and bytes with nobody, with one, and with ten browsers that show everything."""
        for count in (0, 1, 10):
            clients = [self._client(self._port) for _ in range(count)]
            for client in clients:
                client.layer("map")
            time.sleep(2.0)
            used, bytes_before, start = (
                cpu_seconds(self._pid),
                sum(sum(c.size.values()) for c in clients),
                time.monotonic(),
            )
            time.sleep(seconds)
            share = 100.0 * (cpu_seconds(self._pid) - used) / (time.monotonic() - start)
            sent = sum(sum(c.size.values()) for c in clients) - bytes_before
            yield Metric("processor, share of one core", share, "%", parameters={"browsers": count, "time_s": seconds})
            if count == 1:
                yield Metric(
                    "bytes per second", sent / 1e3 / seconds, "kB/s", parameters={"browsers": 1, "time_s": seconds}
                )
            for client in clients:
                client.close()

    def frames(self, seconds: float) -> Iterator[Metric]:
        """Measure the first paint of a browser just started, and how often a page with everything on can draw."""
        page = self._page(self._port)
        paint = page.wait(
            "performance.getEntriesByType('paint').map((p) => p.startTime).slice(-1)[0]", "the first paint"
        )
        mapped = page.wait("(performance.getEntriesByName('map')[0] || {}).startTime", "the map")
        yield Metric("first paint, cold", paint, "ms")
        yield Metric("map in the page, cold", mapped, "ms")
        page.driver.execute_script(BUSY)
        before, start = page.js("page.frames"), time.monotonic()
        time.sleep(seconds)
        drawn = page.js("page.frames") - before
        yield Metric(
            "frames per second, everything on", drawn / (time.monotonic() - start), "1/s", parameters={"gpu": "none"}
        )
        page.close()

    def growth(self, minutes: float) -> Iterator[Metric]:
        """Measure what the memory of page and node grows by while the robot drives."""
        page = self._page(self._port)
        page.wait("page.scene.points.scan && true", "a scan")
        time.sleep(15.0)
        heap, memory = heap_bytes(page), resident_bytes(self._pid)
        time.sleep(60.0 * minutes)
        for name, grown in (
            ("page's heap", heap_bytes(page) - heap),
            ("node's memory", resident_bytes(self._pid) - memory),
        ):
            yield Metric(f"{name} grew by", grown / 2.0 ** 20, "MiB", parameters={"minutes": minutes})
        page.close()

    def latency(self, port: int, moves: int) -> Iterator[Metric]:
        """Measure from a message on /tf, ten a second, to the robot's colour in the canvas of headless Chromium."""
        odometry, send = self._probe_robot()
        self._wait_until(lambda: answers(port), "the second web_view to serve", PATIENCE)
        page = self._page(port)

        def shown() -> Any:
            send(PLACES[1])
            return page.js("page.scene.robot.pose && page.scene.robot.pose[0] > 0.4")

        self._wait_until(shown, "the robot that only moves", PATIENCE, 0.2)
        for layer in page.js("[...document.querySelectorAll('#layers input:checked')].map((box) => box.id)"):
            page.click_hidden(layer)  # so that nothing else is blue
        page.driver.execute_script("page.camera.x = page.camera.y = 0; page.camera.scale = 150; page.redraw();")
        page.driver.execute_script(WATCH, *PLACES[1])
        sent: List[Tuple[float, bool]] = []
        for number in range(moves):
            there = bool(number % 2)
            sent.append((1e3 * time.time(), there))
            send(PLACES[1] if there else PLACES[0])
            time.sleep(0.1)
        time.sleep(0.5)
        samples = delays(sent, page.js("window.seen"))
        page.close()
        odometry.unregister()
        yield metric_of("/tf to the pixel", samples, "ms", rate_hz=10, moves=moves, seen=len(samples))
        yield Metric("/tf to the pixel, 99 %", float(np.percentile(samples, 99)), "ms", repeats=len(samples))

    def stopping(self, repeats: int) -> Iterator[Metric]:
        """Measure from a lost connection to the zero velocity: one that is closed, and one that falls silent."""
        from geometry_msgs.msg import Twist

        heard: List[Tuple[float, float]] = []
        wheels = self._rospy.Subscriber(
            "/cmd_vel", Twist, lambda m: heard.append((time.monotonic(), m.angular.z)), tcp_nodelay=True)
        for name, leave in (("closed", lambda c: c.vanish()), ("silent", lambda c: None)):
            samples = []
            for _ in range(repeats):
                client = self._client(self._port, layers=["state"])
                client.layer("state")

                def moves() -> bool:
                    client.send(do="stick", forward=0.0, left=0.5)
                    return bool(heard) and heard[-1][1] == 0.5

                self._wait_until(moves, "the robot to turn", PATIENCE, 0.05)
                leave(client)
                lost = time.monotonic()
                self._wait_until(lambda: heard[-1][1] == 0.0, "the robot to be stopped", 5.0, 0.002)
                samples.append(1e3 * (heard[-1][0] - lost))
                client.close()
            yield metric_of("lost connection to zero velocity", samples, "ms", connection=name)
        wheels.unregister()

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("measured")

    def _page(self, port: int) -> Any:
        from web_page import WebPage

        page = WebPage()
        page.open(f"http://127.0.0.1:{port}/")
        return page

    def _probe_robot(self) -> Tuple[Any, Callable[[Tuple[float, float]], None]]:
        """Return the odometry that makes a robot of the namespace `probe`, and how to say where it stands."""
        from geometry_msgs.msg import TransformStamped
        from nav_msgs.msg import Odometry
        from tf2_msgs.msg import TFMessage

        odometry = self._rospy.Publisher("/probe/odom", Odometry, queue_size=1)
        publisher = self._rospy.Publisher("/tf", TFMessage, queue_size=1, tcp_nodelay=True)

        def send(place: Tuple[float, float]) -> None:
            transform = TransformStamped(child_frame_id="probe_base")
            transform.header.frame_id, transform.header.stamp = "map", self._rospy.Time.now()
            transform.transform.translation.x, transform.transform.translation.y = place
            transform.transform.rotation.w = 1.0
            publisher.publish(TFMessage([transform]))

        return odometry, send


def answers(port: int) -> bool:
    """Return whether somebody listens on a port of this machine."""
    import socket

    try:
        socket.create_connection(("127.0.0.1", port), 1.0).close()
    except OSError:
        return False
    return True


def heap_bytes(page: Any) -> int:
    """Return what a page holds after a garbage collection."""
    page.driver.execute_cdp_cmd("HeapProfiler.enable", {})
    page.driver.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    return int(page.driver.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"])


def delays(sent: List[Tuple[float, bool]], seen: List[Tuple[float, bool]]) -> List[float]:
    """Return how long (ms) each move took to be seen: the first sight of the same kind before the next move but one."""
    found = []
    for index, (start, there) in enumerate(sent[:-2]):
        times = [when - start for when, what in seen if what == there and start <= when < sent[index + 2][0]]
        if times:
            found.append(min(times))
    return found
