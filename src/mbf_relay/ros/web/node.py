"""web_view: see a robot and drive it from a browser.

Serves one page and one WebSocket at the address it logs. Parameters: those of WebViewParameters (config/README.md).
"""

from __future__ import annotations

import asyncio
import os
import socket
import threading
from typing import Any, List, Set, Tuple

import rosgraph
import rospkg
import rospy
import rospy.impl.simtime
import tornado.httpserver
import tornado.iostream
import tornado.netutil
import tornado.web

from mbf_relay.ros.common import parameters
from mbf_relay.ros.common.node import on_shutdown, spare_what_stays
from mbf_relay.ros.web.browser import Browser
from mbf_relay.ros.web.hub import Hub
from mbf_relay.view.parameters import WebViewParameters
from mbf_relay.view.rights import Tokens, is_loopback, is_own_host, keep_tokens, make_tokens
from mbf_relay.view.wishes import LONGEST

PAGE = os.path.join(os.path.dirname(os.path.abspath(__file__)), "page")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self' "
    "{sockets}; manifest-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""Content-Security-Policy: nothing from elsewhere, no script but the page's own, no other site's frame around it."""
PING_PERIOD = 10.0
"""Wall seconds between two pings, by which a connection that died without a word is found; after three it is closed."""


MOST_CONNECTIONS = 200
"""Connections served at a time, a fifth of the files a process may usually open; a page takes six, for a moment."""


class LimitedServer(tornado.httpserver.HTTPServer):
    """A server that lets go of whoever comes while MOST_CONNECTIONS are served.

    Without a file left for the next connection its loop would look at who waits, and log an error, without a pause. The
    pages' own sockets count no more once they are open; `max_clients` bounds them.
    """

    def handle_stream(self, stream: tornado.iostream.IOStream, address: Tuple[Any, ...]) -> None:
        """Serve a connection, or close it."""
        if len(self._connections) < MOST_CONNECTIONS:
            super().handle_stream(stream, address)
        else:
            stream.close()


class Page(tornado.web.StaticFileHandler):
    """The page's files, to whoever asks for this machine by one of its names."""

    def initialize(self, names: Set[str], **more: Any) -> None:  # type: ignore[override]
        """Take the names of this machine."""
        super().initialize(**more)
        self._names = names

    def prepare(self) -> None:
        """Turn away who asks for another host: a foreign name that was made to point here."""
        if not is_own_host(self.request.host, self._names):
            raise tornado.web.HTTPError(403, reason="Unknown host name; see host_names")

    def set_extra_headers(self, path: str) -> None:
        """Tell the browser what the page may do: little."""
        host = self.request.host
        self.set_header("Content-Security-Policy", POLICY.format(sockets=f"ws://{host} wss://{host}"))
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Cache-Control", "no-cache")


class Server:
    """The event loop and its thread; rospy keeps the main one, whose signal handler must find no lock held there."""

    def __init__(self, settings: WebViewParameters) -> None:
        """Listen.

        Raises:
            OSError: The address cannot be listened on.
        """
        self._settings = settings
        self._loop = asyncio.new_event_loop()
        self.tokens = make_tokens(settings.address, settings.view_token, settings.drive_token)
        self._sockets = tornado.netutil.bind_sockets(settings.port, settings.address)
        self.port = int(self._sockets[0].getsockname()[1])
        self._thread = threading.Thread(target=self._serve, name="web server", daemon=True)
        self._hub = Hub(settings, self._loop)

    def start(self) -> None:
        """Serve, in a thread."""
        self._thread.start()

    def stop(self) -> None:
        """Stop what a browser drives, end what it records, and serve no more."""
        self._hub.close()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(2.0)

    def _serve(self) -> None:
        asyncio.set_event_loop(self._loop)
        names = own_names(self._settings)
        shared = dict(hub=self._hub, tokens=self.tokens, names=names)
        application = tornado.web.Application(
            [
                (r"/socket", Browser, shared),
                (r"/(.*)", Page, dict(names=names, path=PAGE, default_filename="index.html")),
            ],
            websocket_max_message_size=LONGEST,
            websocket_ping_interval=PING_PERIOD,
            websocket_ping_timeout=3 * PING_PERIOD,
            log_function=lambda handler: None,
        )
        server = LimitedServer(
            application, max_buffer_size=1 << 20, max_body_size=0, idle_connection_timeout=30.0)
        server.add_sockets(self._sockets)
        self._loop.run_forever()

    def addresses(self) -> List[str]:
        """Return what a person may enter in a browser, the right to drive included."""
        host = self._settings.address
        if host in ("0.0.0.0", "::", ""):  # noqa: S104 # nosec B104: compared, not bound
            known_as = rosgraph.network.get_address_override() or ""
            host = socket.gethostname() if is_loopback(known_as) else known_as or socket.gethostname()
        host = f"[{host}]" if ":" in host else host
        url = f"http://{host}:{self.port}/"
        tokens = [("drive", self.tokens.drive), ("look", self.tokens.view)]
        return [f"{url}#token={token}  (to {right})" for right, token in tokens if token] or [url]


def own_names(settings: WebViewParameters) -> Set[str]:
    """Return the host names that mean this machine: its own, in multicast DNS too, the one ROS has, and those set."""
    host = socket.gethostname()
    names = {
        "localhost", host, f"{host.split('.')[0]}.local", socket.getfqdn(), rosgraph.network.get_address_override(),
        settings.address, *settings.host_names.split(),
    }
    return {name.lower() for name in names if name}


def leave_simulated_time() -> None:
    """Tell the time by the wall clock and stop listening to /clock, which rospy does unasked: nobody needs it here."""
    rospy.rostime.switch_to_wallclock()
    subscriber = getattr(rospy.impl.simtime, "_clock_sub", None)
    if subscriber is not None:
        subscriber.unregister()


def keep(tokens: Tokens) -> str:
    """Keep the tokens in a file that only its owner reads, and return its path; empty where there are none."""
    if not (tokens.view or tokens.drive):
        return ""
    path = os.path.join(
        rospkg.get_ros_home(), "web_view", f"{rospy.get_name().strip('/').replace('/', '_')}_tokens.json"
    )
    keep_tokens(path, tokens)
    return path


def main() -> None:
    """Run the node until ROS is shut down."""
    settings = parameters.load(WebViewParameters)
    leave_simulated_time()
    server = Server(settings)
    path = keep(server.tokens)
    on_shutdown(server.stop)
    server.start()
    for address in server.addresses():
        rospy.loginfo("see the robot at %s", address)
    if path:
        rospy.loginfo("the tokens are kept in %s", path)
    if not is_loopback(settings.address):
        rospy.logwarn(
            "listening beyond this machine without encryption: anybody on the network can read the token"
        )
    spare_what_stays()
    rospy.spin()
