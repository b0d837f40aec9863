"""One robot on the page: its view and its commands, while a browser shows it or it drives a list of waypoints."""

from __future__ import annotations

from typing import Any, Callable, Dict, FrozenSet, Hashable, List, Mapping, Optional, Protocol, Set

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.ros.web.hands import Hands
from mbf_relay.ros.web.listening import Listening
from mbf_relay.ros.web.recording import Recording
from mbf_relay.ros.web.robot_view import RobotView
from mbf_relay.view.feed import Feed
from mbf_relay.view.layers import ViewLayer
from mbf_relay.view.parameters import WebViewParameters
from mbf_relay.view.rights import Rights
from mbf_relay.view.tour import Tour
from mbf_relay.view.wishes import Refused, Wish


class Onlooker(Hashable, Protocol):
    """Interface of a browser's connection, as hub and robot use it.

    Attributes:
        number: Number of the connection, shown to other browsers.
        feed: The layers it shows, and what was sent of them.
        rights: Whether it may view and drive.
        robot: The robot it shows.
    """

    number: int
    feed: Feed
    rights: Rights
    robot: Optional[ViewedRobot]

    def say(self, what: str, **more: Any) -> None:
        """Send a JSON message of kind `what` with further entries."""

    def welcome(self, is_guess: bool) -> None:
        """Tell it which robot it shows, and whether that robot was only guessed."""

    def send_due(self, layers: Mapping[str, ViewLayer], now: float) -> None:
        """Send the layers that are due at `now` (s), unless it has not yet acknowledged earlier ones."""


class ViewedRobot:
    """Joins a robot's view and its commands, and carries out browsers' requests; used only in the event loop's thread.

    Args:
        namespace: The robot's namespace, with a slash at both ends.
        settings: The node's parameters.
        recording: The node's recorder, which all robots share.
        changed: Called from any thread after each message.
        told: Called from any thread with a text for all browsers that show this robot.

    Attributes:
        lookers: Browsers that show it.
        needed_at: Wall time (s) at which the hub last found it needed.
    """

    def __init__(
        self, namespace: str, settings: WebViewParameters, recording: Recording, changed: Callable[[], None],
        told: Callable[[str], None],
    ) -> None:
        self.namespace, self._settings, self._recording, self._told = namespace, settings, recording, told
        self.listening = Listening(namespace, settings.base_frame, changed)
        self.view = RobotView(self.listening, settings.map_frame)
        self.hands = Hands(namespace, settings.map_frame, told)
        self.lookers: Set[Onlooker] = set()
        self._tour: Optional[Tour] = None
        self._tour_goal: Optional[str] = None
        self._overtakes = False  # whether the tour's goal, which has no id, was sent while another goal was active
        self._tell_at = 0.0
        self.needed_at = 0.0

    @property
    def is_needed(self) -> bool:
        """Whether a browser shows it, or it drives a list of waypoints."""
        return bool(self.lookers) or self._tour is not None

    @property
    def shown(self) -> FrozenSet[str]:
        """Names of the layers that some browser shows."""
        return frozenset(name for looker in self.lookers for name in looker.feed.wanted)

    def update(self, now: float) -> None:
        """Process received messages and continue the list of waypoints; `now` is wall time (s)."""
        self.view.update(now)
        ended, self.view.ended = self.view.ended, []
        if self._tour is not None:
            for goal_id, state in ended:
                self._end_waypoint(goal_id, state, now)
            self._go_on(now)

    def tell(self, now: float, more: Dict[str, Any]) -> None:
        """Update the layer `state`, with `more` entries of the hub, at most once per period; `now` is wall time (s)."""
        if now < self._tell_at:
            return
        self._tell_at = now + self.view.state.period
        holder = self.hands.holder
        trouble = self._recording.check()
        if trouble:
            self._told(trouble)
        self.view.state.show({
            **self.view.words(now), **more, "driver": getattr(holder, "number", None),
            "tour": None if self._tour is None else self._tour.as_dict(), "recording": self._recording.is_on,
        })

    def do(self, who: Hashable, wish: Wish) -> None:
        """Carry out a request of a browser that may drive.

        Raises:
            Refused: It cannot be carried out; the text says why.
        """
        getattr(self, f"_do_{wish.name}")(who, **wish.values)

    def _do_goal(self, _who: Hashable, x: float, y: float, theta: float) -> None:
        self._need_place()
        self._tour = None
        self.hands.goal(Pose2D(x, y, theta), self.view.tells_status)

    def _do_tour(self, _who: Hashable, waypoints: List[Pose2D], loop: bool, pause: float) -> None:
        self._need_place()
        self._tour, self._tour_goal = Tour(waypoints, loop, pause), None

    def _do_cancel(self, _who: Hashable) -> None:
        self._tour = None
        self.hands.cancel()

    def _do_pose(self, _who: Hashable, x: float, y: float, theta: float, spread: float, turn_spread: float) -> None:
        self._need_place()
        self.hands.estimate(Pose2D(x, y, theta), spread, turn_spread)

    def _do_clear(self, _who: Hashable) -> None:
        self.hands.clear_costmaps()

    def _do_stick(self, who: Hashable, forward: float, left: float) -> None:
        if self.hands.holder in (None, who):  # driving by hand cancels goals, also those sent meanwhile
            self._tour = None
            try:
                self.hands.cancel()
            except Refused:
                pass  # no node takes goals, so none is active
        self.hands.push(who, Twist2D(forward * self._settings.teleop_speed, 0.0, left * self._settings.teleop_turn))

    def _do_release(self, who: Hashable) -> None:
        self.hands.let_go(who)

    def _do_record(self, _who: Hashable, on: bool) -> None:
        if not on:
            self._recording.stop()
            return
        try:
            self._told(f"recording to {self._recording.start(self.namespace)}")
        except OSError as error:
            raise Refused(f"the recording cannot be started: {error}") from error

    def _do_reset(self, _who: Hashable) -> None:
        self._tour = None
        self.hands.reset_world()

    def _do_obstacle(self, _who: Hashable, x: float, y: float, size: float) -> None:
        self.hands.set_obstacle(x, y, size)

    def _do_remove_obstacles(self, _who: Hashable) -> None:
        self.hands.remove_obstacles(self.view.set_down)

    def _need_place(self) -> None:
        """Raise Refused where there is neither a map nor the robot's pose in the map frame."""
        if not self.view.has_map and self.view.pose is None:
            topics = sorted({f"{self.namespace}map", "/map"})
            raise Refused(
                f"there is no map (nobody publishes {' or '.join(topics)}), and nothing tells where the robot is in "
                f"frame '{self._settings.map_frame}'; map_frame names the frame of goals, such as odom without a map")

    def _end_waypoint(self, goal_id: str, state: str, now: float) -> None:
        if self._tour is None or self._tour_goal is None or self._tour_goal not in ("", goal_id):
            return
        if self._overtakes and state == "cancelled":  # the other goal
            self._overtakes = False
            return
        self._tour_goal = None
        if state == "reached":
            self._tour.reached(now)
        else:
            self._tour = None
            self._told(
                f"the list of waypoints ends here: a goal was {state if state == 'cancelled' else 'not reached'}"
            )

    def _go_on(self, now: float) -> None:
        if self._tour is None:
            return
        if self._tour.is_over:
            self._tour = None
            self._told("all waypoints were reached")
            return
        goal = self._tour.next_goal(now)
        if goal is not None:
            try:
                self._tour_goal = self.hands.goal(goal, self.view.tells_status)
                self._overtakes = not self._tour_goal and self.view.story.state == "active"
            except Refused as error:
                self._tour = None
                self._told(str(error))
