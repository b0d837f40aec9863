"""Connects browsers and robots: which browser shows which robot, what is sent when, and the topics that needs."""

from __future__ import annotations

import asyncio
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Callable, Dict, FrozenSet, List, Optional

import rosgraph
import rospkg
import rospy

from mbf_relay.ros.web.recording import Recording
from mbf_relay.ros.web.robot import Onlooker, ViewedRobot
from mbf_relay.ros.web.sources import robots_of
from mbf_relay.view.parameters import WebViewParameters
from mbf_relay.view.wishes import DRIVING, Refused, Wish

PUMP_PERIOD = 0.066
"""Least wall time (s) between two update rounds: 15 Hz look smooth and do not overload a phone."""
IDLE_PERIOD = 0.25
"""Longest wall time (s) between two update rounds, while there are robots."""
LOOK_PERIOD = 2.0
"""Wall time (s) between two requests of the published topics from the master, while there are robots."""
MASTER_PATIENCE = 6.0
KEPT_UNSEEN = 5.0
"""Wall time (s) for which a robot that no browser shows is kept, for pages that are reloaded. A publisher that is
unregistered and advertised again at once may lose rospy's subscribers for good, among them that of cmd_vel."""


class Hub:
    """Used only in the event loop's thread, apart from `changed` and the work given to `_graph`.

    `_graph` is a single thread for all calls of the ROS master, which may hang.
    """

    def __init__(self, settings: WebViewParameters, loop: asyncio.AbstractEventLoop) -> None:
        self.settings = settings
        self._loop = loop
        folder = settings.record_folder or os.path.join(rospkg.get_ros_home(), "web_view")
        self._recording = Recording(folder, settings.record_minutes)
        self._graph = ThreadPoolExecutor(1, thread_name_prefix="web graph")
        self._master = rosgraph.Master(rospy.get_name())
        self.robots: Dict[str, ViewedRobot] = {}
        self.browsers: List[Onlooker] = []
        self._known_robots: List[str] = []
        self._guesses: Dict[Onlooker, bool] = {}  # whether a browser's robot was neither found nor asked for
        self._published: Dict[str, str] = {}
        self._master_seen = time.monotonic()
        self._looking = False
        self._next_look = 0.0
        self._pump_handle: Optional[asyncio.TimerHandle] = None
        self._last_pump = 0.0
        self._wake_lock = threading.Lock()
        self._woken = False

    # --- browsers come and go ---

    def join(self, browser: Onlooker, name: str) -> None:
        """Show a browser the robot it asks for, instead of the one it showed before, and tell it which one that is.

        Without a name that is the robot in this node's namespace, or else the first one. Where no robot is found yet,
        that is a guess, and the browser gets the first robot that is found. A new browser's name is kept, also while
        there is no such robot.
        """
        known, own = self._known_robots, rospy.get_namespace()
        namespace = f"/{name.strip('/')}/".replace("//", "/")
        is_new = browser.robot is None and rosgraph.names.is_legal_name(namespace)
        is_guess = False
        if not (name and (is_new or namespace in known)):
            namespace = own if own in known or not known else known[0]
            is_guess = namespace not in known
        self.leave_robot(browser)
        self._guesses[browser] = is_guess
        robot = self.robots.get(namespace)
        if robot is None:
            robot = ViewedRobot(namespace, self.settings, self._recording, self.changed, self._teller(namespace))
            self.robots[namespace] = robot
            self._graph.submit(logged(robot.listening.open))
            self._graph.submit(logged(robot.hands.open))
        robot.lookers.add(browser)
        browser.robot = robot
        browser.feed.forget()
        browser.welcome(is_guess)
        self.reconcile()
        self._pump_soon(0.0)

    def leave_robot(self, browser: Onlooker) -> None:
        """Detach a browser from its robot; stop the robot if the browser drove it by hand."""
        robot = browser.robot
        browser.robot = None
        self._guesses.pop(browser, None)
        if robot is not None:
            robot.hands.let_go(browser)
            robot.lookers.discard(browser)
            self.reconcile()

    def reconcile(self) -> None:
        """Update the subscriptions soon; called when the layers shown have changed."""
        self._next_look = 0.0
        self._pump_soon(PUMP_PERIOD)

    def carry_out(self, browser: Onlooker, wish: Wish) -> None:
        """Carry out a browser's request to its robot; raise Refused where it may not or cannot."""
        if wish.name in DRIVING and not browser.rights.drive:
            raise Refused("this browser may look but not drive; that takes the drive token")
        assert browser.robot is not None  # it said hello
        browser.robot.do(browser, wish)
        self._pump_soon(0.0)

    def close(self) -> None:
        """Stop robots that are driven by hand, and end the recording."""
        for robot in self.robots.values():
            robot.hands.close()
        self._recording.close()

    # --- news ---

    def changed(self) -> None:
        """Request an update round; called from any thread after each message."""
        with self._wake_lock:
            if self._woken:
                return
            self._woken = True
        try:
            self._loop.call_soon_threadsafe(self._pump_soon, 0.0)
        except RuntimeError:
            pass  # the loop has ended, as the node does

    def _teller(self, namespace: str) -> Callable[[str], None]:
        def tell(words: str) -> None:
            def say() -> None:
                for browser in list(self.robots[namespace].lookers) if namespace in self.robots else ():
                    browser.say("told", text=words)

            self._loop.call_soon_threadsafe(say)

        return tell

    def _pump_soon(self, delay: float) -> None:
        """Schedule an update round after a delay (s), unless one is due earlier; keep PUMP_PERIOD to the last."""
        due = max(self._loop.time() + delay, self._last_pump + PUMP_PERIOD)
        if self._pump_handle is not None:
            if self._pump_handle.when() <= due:
                return
            self._pump_handle.cancel()
        self._pump_handle = self._loop.call_at(due, self._pump)

    def _pump(self) -> None:
        """Update all robots, send all browsers what is due, and schedule the next round while there are robots."""
        self._pump_handle, self._last_pump = None, self._loop.time()
        with self._wake_lock:
            self._woken = False
        now = time.monotonic()
        for namespace, robot in list(self.robots.items()):
            if robot.is_needed:
                robot.needed_at = now
            elif now - robot.needed_at > KEPT_UNSEEN:
                del self.robots[namespace]
                robot.hands.let_go(robot.hands.holder)
                self._graph.submit(logged(robot.listening.close))
                self._graph.submit(logged(robot.hands.close))
                continue
            robot.update(now)
            robot.tell(
                now,
                {
                    "robots": self._known_robots,
                    "browsers": len(self.browsers),
                    "master": now - self._master_seen < MASTER_PATIENCE,
                    "simulator": f"{namespace}simulator/obstacles" in self._published,
                },
            )
            for browser in robot.lookers:
                browser.send_due(robot.view.layers, now)
        if self.robots:
            if now >= self._next_look and not self._looking:
                self._looking, self._next_look = True, now + LOOK_PERIOD
                shown = {robot: robot.shown for robot in self.robots.values()}
                self._graph.submit(logged(lambda: self._look(shown)))
            self._pump_soon(IDLE_PERIOD)

    # --- the graph ---

    def _look(self, shown: Dict[ViewedRobot, FrozenSet[str]]) -> None:
        """Get the published topics from the master and update subscriptions; runs in the graph thread."""
        found: Optional[Dict[str, str]] = None
        try:
            found = {str(topic): str(kind) for topic, kind in self._master.getPublishedTopics("")}
            for robot, layers in shown.items():
                robot.listening.reconcile(layers, found)
        except (OSError, rosgraph.MasterException):
            pass  # the page shows that the master does not answer
        finally:
            self._loop.call_soon_threadsafe(self._looked, found)

    def _looked(self, published: Optional[Dict[str, str]]) -> None:
        self._looking = False
        if published is None:
            return
        self._master_seen = time.monotonic()
        self._published = published
        self._known_robots = robots_of(published)
        for browser in [browser for browser, is_guess in self._guesses.items() if is_guess and self._known_robots]:
            if browser.robot is not None and browser.robot.namespace in self._known_robots:
                self._guesses[browser] = False
            else:
                self.join(browser, "")
        for robot in self.robots.values():
            robot.view.look_for_others()
        self._pump_soon(0.0)


def logged(work: Callable[[], Any]) -> Callable[[], None]:
    """Return `work` with its errors logged, which a thread pool would swallow."""
    def do() -> None:
        try:
            work()
        except (OSError, rospy.ROSException, rosgraph.MasterException, ValueError, KeyError) as error:
            rospy.logwarn("web view: %s: %s", type(error).__name__, error)

    return do
