#!/usr/bin/env python3
"""The page in a browser.

It shows map and robot, a drag sends a goal, Stop stops, a token opens, a killed node comes back.
"""

import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest

import rostest
from geometry_msgs.msg import Twist
from rosgraph_msgs.msg import Log

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), ".."))
sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from programs import program  # noqa: E402
from ros_testing import Listener, connected_publisher, wait_until  # noqa: E402
from running_stack import Witness, start_test_node  # noqa: E402
from web_client import WebClient  # noqa: E402
from web_page import WebPage, missing  # noqa: E402

from mbf_relay.ros.tools.demo_graph import free_port  # noqa: E402

MARKUP = "<img src=x onerror='window.broken = true'><script>window.broken = true</script>"
GOAL = (-1.75, 0.74, math.radians(65))
AXE = "axe-core@4.10.2"
SHIFTED = """
const [dx, dy, done] = arguments;
Promise.all([import("/painter.js"), import("/camera.js")]).then(([{ Painter }, { Camera }]) => {
  const { scene } = page, { pose, frames } = scene.robot;
  const picture = (dx, dy) => {
    const moved = ([x, y, ...others]) => [x + dx, y + dy, ...others];
    const movedPoints = ({ columns, values }) => (
      { columns, values: values.map((value, i) => value + [dx, dy, 0][i % columns]) });
    const grids = {}, points = {};
    for (const [name, grid] of Object.entries(scene.grids)) {
      grids[name] = Object.assign(Object.create(Object.getPrototypeOf(grid)), grid);
      const { shape } = grid;
      if (shape && !frames[shape.frame]) grids[name].shape = { ...shape, origin: moved(shape.origin) };
    }
    for (const [name, one] of Object.entries(scene.points)) points[name] = movedPoints(one);
    const robot = { ...scene.robot, pose: moved(pose), frames: {} };
    for (const name in frames) robot.frames[name] = moved(frames[name]);
    const canvas = document.createElement("canvas"), camera = new Camera(), painter = new Painter(canvas, camera);
    [canvas.width, canvas.height] = [camera.width, camera.height] = [400, 300];
    painter.ratio = 1;
    [camera.x, camera.y, camera.scale] = [...moved(pose).slice(0, 2), 120];
    const shown = new Set(["map", "local_costmap", "grid", "scan", "particles", "footprint", "trail"]);
    painter.draw({ ...scene, grids, points, robot, trail: scene.trail.map(moved) }, shown, { waypoints: [] });
    return painter.context.getImageData(0, 0, 400, 300).data;
  };
  const here = picture(0, 0), there = picture(dx, dy);
  let different = 0;
  for (let i = 0; i < here.length; i++) different += Math.abs(here[i] - there[i]) > 40;
  done([different / here.length, new Set(here).size]);
});
"""
"""Draws what the page shows here, and moved to elsewhere; returns the share of values that differ, and how many there
are."""


class Server:
    """web_view as a process that can be killed and started again."""

    def __init__(self, name, **parameters):
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}/"
        words = [f"_{key}:={value}" for key, value in {"port": self.port, **parameters}.items()]
        self._command = [program("web_view"), f"__name:={name}", *words]
        self.start()

    def start(self):
        """Start it."""
        self.process = subprocess.Popen(self._command)

    def end(self, number=signal.SIGINT):
        """End it."""
        self.process.send_signal(number)
        self.process.wait(20.0)


@unittest.skipIf(missing(), missing())
class WebBrowserTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.witness = Witness()
        cls.server = Server("browser_view")
        cls.page = WebPage()
        cls.velocity = Listener("cmd_vel", Twist)
        wait_until(cls.reached, "web_view to serve", 90.0)
        cls.page.wait("page.state && page.state.has_map && page.scene.robot.pose && true", "map and robot")
        cls.page.wait(
            "document.getElementById('diagnostics').textContent.includes('ready for goals')", "a relay with its server"
        )

    @classmethod
    def reached(cls):
        """Return whether the page could be loaded."""
        try:
            cls.page.open(cls.server.url)
        except Exception as error:  # selenium's, which is not there to be named where there is no browser
            if "ERR_CONNECTION_REFUSED" not in str(error):
                raise
        return cls.page.js("Boolean(window.page)")

    @classmethod
    def tearDownClass(cls):
        cls.page.close()
        cls.server.end()

    def test_1_it_shows_the_map_and_the_robot_where_it_is(self):
        page, pose = self.page, self.witness.pose
        page.wait("page.scene.grids.map.shape && page.scene.points.scan && true", "map and scan")
        x, y, _ = page.js("page.scene.robot.pose")
        self.assertLess(math.hypot(x - pose.x, y - pose.y), 0.2)
        wait_until(lambda: page.colours() > 20, "the map to be drawn")
        self.assertEqual(page.text("connection"), "live")
        self.assertEqual(page.complaints(), [])

    def test_1_it_shows_a_map_in_coordinates_of_the_world_as_sharply(self):
        """A canvas reckons in single precision: robot and walls jumped by half a metre."""
        self.page.wait("page.scene.points.scan && page.scene.grids.local_costmap.shape && true", "scan and costmap")
        different, values = self.page.driver.execute_async_script(SHIFTED, 500_000, 4_500_000)
        self.assertGreater(values, 20)
        self.assertLess(different, 0.005)

    def test_2_a_drag_sends_a_goal_and_the_robot_arrives(self):
        self.page.drag("goal", *GOAL)
        self.page.wait(
            "page.scene.points.global_plan && page.scene.points.global_plan.values.length > 2", "the way to the goal"
        )
        self.page.wait("page.state.goal.state === 'reached'", "the goal to be reached", 120.0)
        pose = self.witness.pose
        self.assertLess(math.hypot(pose.x - GOAL[0], pose.y - GOAL[1]), 0.35)
        self.assertLess(abs(math.remainder(pose.theta - GOAL[2], 2.0 * math.pi)), 0.6)
        self.assertEqual(self.page.text("outcome"), "Goal reached")
        self.assertEqual(self.witness.touched(), [])

    def test_3_stop_stops_the_robot_on_its_way(self):
        self.page.drag("goal", 1.8, -0.5, 0.0)
        self.page.wait("page.state.goal.driving && Math.abs(page.scene.robot.speed[0]) > 0.05", "the robot to drive")
        self.page.click("cancel")
        self.page.wait("page.state.goal.state === 'cancelled'", "the goal to be cancelled")
        self.page.wait("Math.abs(page.scene.robot.speed[0]) < 0.01", "the robot to stand")
        self.assertEqual(self.page.text("outcome"), "Cancelled")

    def test_4_the_stick_drives_while_it_is_held_and_no_longer(self):
        before = len(self.velocity.messages)
        box = self.page.js("(() => { const b = document.getElementById('stick').getBoundingClientRect();"
                           "return [b.left + b.width / 2, b.top + b.height / 2]; })()")
        self.page._mouse("mousePressed", *box)
        self.page._mouse("mouseMoved", box[0] - 30, box[1])
        self.velocity.wait_for(lambda v: v.angular.z > 0.2, "a turn to the left", since=before)
        self.page._mouse("mouseReleased", box[0] - 30, box[1])
        wait_until(lambda: self.velocity.messages[-1] == Twist(), "the robot to be stopped")

    def test_5_text_of_topics_is_text_and_no_markup(self):
        log = connected_publisher("/rosout", Log)

        def told():
            log.publish(Log(level=Log.WARN, name="/evil", msg=MARKUP))
            return MARKUP in self.page.text("log")

        wait_until(told, "the warning in the page", period=0.3)
        self.assertFalse(self.page.js("Boolean(window.broken)"))
        self.assertEqual(self.page.js("document.querySelectorAll('#log img, #log script').length"), 0)

    def test_6_a_killed_node_comes_back_in_the_page(self):
        self.server.end(signal.SIGKILL)
        self.page.wait("!document.getElementById('banner').hidden", "a word that the connection is lost")
        self.assertIn("old", self.page.text("banner"))
        self.server.start()
        self.page.wait("document.getElementById('connection').textContent === 'live'", "the connection to come back")
        frames = self.page.js("page.frames")
        self.page.wait(f"page.frames > {frames} && document.getElementById('banner').hidden", "news")

    def test_7_a_wrong_token_gets_nothing_and_the_right_one_what_it_is_for(self):
        guarded, page = (
            Server("guarded_browser_view", view_token="see", drive_token="steer"),
            WebPage(390, 780, phone=True),
        )
        try:
            def asks():
                try:
                    page.open(f"{guarded.url}#token=wrong")
                    return page.js("Boolean(window.page)")
                except Exception as error:
                    if "ERR_CONNECTION_REFUSED" not in str(error):
                        raise
                    return False

            wait_until(asks, "web_view to serve", 90.0)
            page.wait("document.getElementById('token-dialog').open", "the question for a token")
            self.assertIn("wrong", page.text("token-wrong"))
            self.assertIsNone(page.js("page.state"))
            self.assertIsNone(page.js("page.scene.grids.map.shape"))
            self.assertEqual(page.js("location.hash"), "")
            page.driver.find_element("id", "token").send_keys("see\n")
            page.wait("page.scene.grids.map.shape && true", "the map")
            self.assertEqual(page.js("getComputedStyle(document.getElementById('cancel')).display"), "none")
            scale = page.js("page.camera.scale")
            for kind, apart in (("touchStart", 40), ("touchMove", 60), ("touchMove", 80)):
                page.touch(kind, [(195 - apart, 300), (195 + apart, 300)])
            page.touch("touchEnd", [])
            page.wait(f"Math.abs(page.camera.scale / {scale} - 2) < 0.2", "the map to be twice as large after a pinch")
            self.assertEqual(page.complaints(), [])
        finally:
            page.close()
            guarded.end()

    def test_8_keyboard_and_screen_reader_find_what_they_need(self):
        axe = fetch_axe()
        if axe is None:
            self.skipTest("npm is not there or cannot fetch axe-core")
        for dark in (False, True):
            half_way = self.page.js(
                f"document.documentElement.dataset.theme === '{'dark' if dark else 'light'}' "
                "|| document.getElementById('theme').click(), document.getAnimations().length")
            self.assertEqual(half_way, 0, "colours that change gradually cannot be read half way")
            self.page.driver.execute_script(axe)
            found = self.page.driver.execute_async_script(
                "const done = arguments[0]; axe.run(document).then((r) => done(r.violations.map((v) =>"
                "({id: v.id, impact: v.impact, nodes: v.nodes.map((n) => n.html + n.failureSummary).slice(0, 3)}))));")
            self.assertEqual([v for v in found if v["impact"] in ("serious", "critical")], [])

    def test_9_a_page_that_was_left_is_no_onlooker_and_is_live_again_once_one_goes_back(self):
        other = WebClient(self.server.port)
        try:
            other.layer("state", lambda state: state["browsers"] == 2, "with two browsers")
            self.page.driver.get("about:blank")
            other.layer("state", lambda state: state["browsers"] == 1, "with one browser")
            self.page.driver.back()
            other.layer("state", lambda state: state["browsers"] == 2, "with two browsers again")
            self.page.wait("document.getElementById('connection').textContent === 'live'", "the connection")
        finally:
            other.close()


def fetch_axe():
    """Return axe-core's source, None where it cannot be had."""
    npm = shutil.which("npm")
    if npm is None:
        return None
    with tempfile.TemporaryDirectory() as folder:
        try:
            subprocess.run(
                [npm, "install", "--no-audit", "--no-fund", "--ignore-scripts", "--prefix", folder, AXE], cwd=folder,
                stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, timeout=60.0, check=True)
        except (subprocess.CalledProcessError, subprocess.TimeoutExpired):
            return None
        path = os.path.join(folder, "node_modules", "axe-core", "axe.min.js")
        with open(path, encoding="utf-8") as stream:
            return stream.read()


if __name__ == "__main__":
    start_test_node("web_browser_test")
    rostest.rosrun("mbf_relay", "web_browser", WebBrowserTest)
