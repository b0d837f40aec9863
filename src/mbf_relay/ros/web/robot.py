"""One robot with everything a browser sees and does of it, alive while somebody looks or it is on a tour."""

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
    """Who looks at a robot: a browser's connection, as the hub and the robot know it.

    Attributes:
        number: Which one it is, for the others.
        feed: What it is shown, and what it has already.
        rights: What it may do.
        robot: The robot it looks at.
    """

    number: int
    feed: Feed
    rights: Rights
    robot: Optional[ViewedRobot]

    def say(self, what: str, **more: Any) -> None:
        """Send words."""

    def welcome(self, is_guess: bool) -> None:
        """Tell it which robot it looks at, and whether that is a guess."""

    def send_due(self, layers: Mapping[str, ViewLayer], now: float) -> None:
        """Send what is due at `now` (s), if it is ready for it."""


class ViewedRobot:
    """Joins view and hands, and carries out wishes; used from the thread that serves browsers.

    Args:
        namespace: The robot's, with a slash at both ends.
        settings: The node's parameters.
        recording: The node's one recorder.
        changed: Called from any thread when something came.
        told: Called from any thread with words for whoever looks at this robot.

    Attributes:
        lookers: Browsers that look at it.
        needed_at: When it was last needed, as far as somebody asked (wall s).
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
        self._overtakes = False  # whether the tour's goal, that bears no id, was sent while another one ran
        self._tell_at = 0.0
        self.needed_at = 0.0

    @property
    def is_needed(self) -> bool:
        """Whether somebody looks, or a tour goes on without."""
        return bool(self.lookers) or self._tour is not None

    @property
    def shown(self) -> FrozenSet[str]:
        """The layers somebody looks at."""
        return frozenset(name for looker in self.lookers for name in looker.feed.wanted)

    def update(self, now: float) -> None:
        """Take what came, and go on with the tour; `now` in seconds of the wall clock."""
        self.view.update(now)
        ended, self.view.ended = self.view.ended, []
        if self._tour is not None:
            for goal_id, state in ended:
                self._end_waypoint(goal_id, state, now)
            self._go_on(now)

    def tell(self, now: float, more: Dict[str, Any]) -> None:
        """Show the words and figures, with `more` that the server knows, as often as they are sent."""
        if now < self._tell_at:
            return
        self._tell_at = now + self.view.state.period
        holder = self.hands.holder
        trouble = self._recording.look()
        if trouble:
            self._told(trouble)
        self.view.state.show({
            **self.view.words(now), **more, "driver": getattr(holder, "number", None),
            "tour": None if self._tour is None else self._tour.as_dict(), "recording": self._recording.is_on,
        })

    def do(self, who: Hashable, wish: Wish) -> None:
        """Carry out a wish of one who may drive.

        Raises:
            Refused: It cannot be; the text says why.
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
        if self.hands.holder in (None, who):  # whoever has the stick has the robot, also from goals sent meanwhile
            self._tour = None
            try:
                self.hands.cancel()
            except Refused:
                pass  # nobody takes goals, and so there is none
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
        """Refuse where neither a map nor the robot's place in its frame tells what a place in it means."""
        if not self.view.has_map and self.view.pose is None:
            topics = sorted({f"{self.namespace}map", "/map"})
            raise Refused(
                f"there is no map (nobody publishes {' or '.join(topics)}), and nothing tells where the robot is in "
                f"frame '{self._settings.map_frame}'; map_frame names the frame of goals, such as odom without a map")

    def _end_waypoint(self, goal_id: str, state: str, now: float) -> None:
        if self._tour is None or self._tour_goal is None or self._tour_goal not in ("", goal_id):
            return
        if self._overtakes and state == "cancelled":  # the other one
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
