"""The connection of one browser: its rights, its requests and the data sent to it."""

from __future__ import annotations

import itertools
import json
import time
from typing import Any, Callable, Dict, Mapping, Optional

import rospy
import tornado.ioloop
import tornado.websocket

from mbf_relay.ros.web.hub import Hub
from mbf_relay.ros.web.robot import ViewedRobot
from mbf_relay.view.feed import Feed
from mbf_relay.view.layers import ViewLayer
from mbf_relay.view.limits import RateLimit
from mbf_relay.view.rights import Rights, Tokens, is_own_page
from mbf_relay.view.wishes import Refused, Wish, wish_from

HELLO_PATIENCE = 10.0
"""Wall time (s) within which a connection must send its token."""
WISHES = 80.0
"""Allowed rate (Hz) of a browser's messages: nearly three times that of a page that drives by hand (12.5) and
acknowledges every batch (15, see hub.PUMP_PERIOD)."""
POLICY, TOO_MANY = 1008, 1013
"""Close codes of WebSocket (RFC 6455 and its registry): policy violation, and try again later."""
_numbers = itertools.count(1)


class Browser(tornado.websocket.WebSocketHandler):
    """A WebSocket: receives requests as JSON, sends layers as bytes and all else as JSON."""

    def initialize(self, hub: Hub, tokens: Tokens, names: Any) -> None:
        """Take the objects that all connections share."""
        self._hub, self._tokens, self._names = hub, tokens, names
        self.number = next(_numbers)
        self.feed = Feed()
        self.rights = Rights(False, False)
        self.robot: Optional[ViewedRobot] = None
        self._limit = RateLimit(WISHES, 2.0 * WISHES)
        self._hello_timer: Optional[object] = None
        self._answers: Dict[str, Callable[[Wish], None]] = {
            "ack": self._take_ack, "show": self._take_show, "robot": self._take_robot, "ping": self._take_ping,
        }

    def check_origin(self, origin: str) -> bool:
        """Return whether the request is from a page of this server; those of other sites are refused."""
        return is_own_page(origin, self.request.host, self._names)

    def open(self, *_: str, **__: str) -> None:
        """Accept a connection, or close it with a reason."""
        self.set_nodelay(True)
        if not is_own_page(self.request.headers.get("Origin"), self.request.host, self._names):
            self._turn_away("this is not the address of this server", POLICY)
        elif len(self._hub.browsers) >= self._hub.settings.max_clients:
            self._turn_away(
                f"{self._hub.settings.max_clients} browsers are connected already; try again later", TOO_MANY
            )
        else:
            self._hub.browsers.append(self)
            self._hello_timer = tornado.ioloop.IOLoop.current().call_later(
                HELLO_PATIENCE, self._turn_away, "no token came", POLICY)

    def on_message(self, message: Any) -> None:
        """Carry out a request, or answer why it is refused."""
        if self not in self._hub.browsers:
            return  # turned away
        if not self._limit.allows(time.monotonic()):
            self._turn_away(f"more than {WISHES:.0f} messages a second", POLICY)
            return
        name = ""
        try:
            wish = wish_from(message)
            name = wish.name
            if name == "hello":
                self._take_hello(wish)
            elif not self.rights.view or self.robot is None:
                raise Refused("say hello first")
            elif name in self._answers:
                self._answers[name](wish)
            else:
                self._hub.carry_out(self, wish)
        except Refused as error:
            self.say("refused", wish=name, why=str(error))

    def on_close(self) -> None:
        """Detach from the robot, which stops if this browser drove it by hand."""
        if self._hello_timer is not None:
            tornado.ioloop.IOLoop.current().remove_timeout(self._hello_timer)
            self._hello_timer = None
        self._hub.leave_robot(self)
        if self in self._hub.browsers:
            self._hub.browsers.remove(self)

    def say(self, what: str, **more: Any) -> None:
        """Send a JSON message of kind `what` with further entries."""
        self._write(json.dumps({"say": what, **more}), binary=False)

    def welcome(self, is_guess: bool) -> None:
        """Tell which robot is shown, and whether it was guessed because no robot is found yet."""
        assert self.robot is not None
        self.say("welcome", number=self.number, drive=self.rights.drive, robot=self.robot.namespace, guess=is_guess)

    def send_due(self, layers: Mapping[str, ViewLayer], now: float) -> None:
        """Send the layers that are due at `now` (s), unless the browser has not yet acknowledged earlier ones."""
        content = self.feed.next_batch(layers, now)
        if content is not None:
            self._write(content, binary=True)

    def _write(self, content: Any, binary: bool) -> None:
        try:
            future = self.write_message(content, binary)
        except tornado.websocket.WebSocketClosedError:
            return  # on_close follows
        future.add_done_callback(lambda done: done.exception())

    def _take_hello(self, wish: Wish) -> None:
        rights = self._tokens.rights(wish.values["token"])
        if not rights.view:
            rospy.logwarn("a browser at %s was turned away: its token is wrong or missing", self.request.remote_ip)
            self._turn_away("the token is wrong or missing", POLICY)
            return
        self.rights = rights
        if self._hello_timer is not None:
            tornado.ioloop.IOLoop.current().remove_timeout(self._hello_timer)
            self._hello_timer = None
        self._hub.join(self, wish.values["robot"])

    def _take_ack(self, wish: Wish) -> None:
        self.feed.acknowledge(int(wish.values["number"]))
        if self.robot is not None and self.feed.next_due(self.robot.view.layers, 0.0) is not None:
            self._hub.changed()

    def _take_show(self, wish: Wish) -> None:
        before = set(self.feed.wanted)
        self.feed.want({name: 1.0 / hertz for name, hertz in wish.values["layers"].items()})
        if set(self.feed.wanted) != before:
            self._hub.reconcile()

    def _take_robot(self, wish: Wish) -> None:
        self._hub.join(self, wish.values["name"])

    def _take_ping(self, wish: Wish) -> None:
        self.say("pong", time=wish.values["time"])

    def _turn_away(self, why: str, code: int) -> None:
        self.say("goodbye", why=why)
        if self in self._hub.browsers:
            self._hub.browsers.remove(self)
        self._hub.leave_robot(self)
        self.close(code, why)
