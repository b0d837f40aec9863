"""The web_view node: shows a robot in a browser and takes commands from there.

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
"""Content-Security-Policy: no other origins, no inline scripts, no framing by other sites."""
PING_PERIOD = 10.0
"""Wall time (s) between two pings; a connection that answers none for three periods is closed."""


MOST_CONNECTIONS = 200
"""Most HTTP connections at a time: a fifth of the usual limit of open files. A page takes six while it loads."""


class LimitedServer(tornado.httpserver.HTTPServer):
    """An HTTP server that closes new connections while there are MOST_CONNECTIONS.

    Without a free file descriptor, its loop would try to accept the next connection and log an error without pause.
    Open WebSockets do not count here; `max_clients` limits them.
    """

    def handle_stream(self, stream: tornado.iostream.IOStream, address: Tuple[Any, ...]) -> None:
        """Serve a new connection, or close it at the limit."""
        if len(self._connections) < MOST_CONNECTIONS:
            super().handle_stream(stream, address)
        else:
            stream.close()


class Page(tornado.web.StaticFileHandler):
    """The files of the page, for requests whose Host header is a name of this machine."""

    def initialize(self, names: Set[str], **more: Any) -> None:  # type: ignore[override]
        """Take the names of this machine."""
        super().initialize(**more)
        self._names = names

    def prepare(self) -> None:
        """Refuse requests for other host names, as by DNS rebinding."""
        if not is_own_host(self.request.host, self._names):
            raise tornado.web.HTTPError(403, reason="Unknown host name; see host_names")

    def set_extra_headers(self, path: str) -> None:
        """Set the headers that restrict what the page may do."""
        host = self.request.host
        self.set_header("Content-Security-Policy", POLICY.format(sockets=f"ws://{host} wss://{host}"))
        self.set_header("X-Content-Type-Options", "nosniff")
        self.set_header("Referrer-Policy", "no-referrer")
        self.set_header("Cache-Control", "no-cache")


class Server:
    """The event loop in its thread; the main thread is rospy's, whose signal handler must find no lock held there."""

    def __init__(self, settings: WebViewParameters) -> None:
        """Bind the address.

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
        """Start the thread that serves."""
        self._thread.start()

    def stop(self) -> None:
        """Stop robots that are driven by hand, end the recording, and stop serving."""
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
        """Return the URLs to open in a browser, with the tokens of the rights to drive and to look."""
        host = self._settings.address
        if host in ("0.0.0.0", "::", ""):  # noqa: S104 # nosec B104: compared, not bound
            known_as = rosgraph.network.get_address_override() or ""
            host = socket.gethostname() if is_loopback(known_as) else known_as or socket.gethostname()
        host = f"[{host}]" if ":" in host else host
        url = f"http://{host}:{self.port}/"
        tokens = [("drive", self.tokens.drive), ("look", self.tokens.view)]
        return [f"{url}#token={token}  (to {right})" for right, token in tokens if token] or [url]


def own_names(settings: WebViewParameters) -> Set[str]:
    """Return this machine's names, lower case: hostname, mDNS name, ROS_HOSTNAME or ROS_IP, address and host_names."""
    host = socket.gethostname()
    names = {
        "localhost", host, f"{host.split('.')[0]}.local", socket.getfqdn(), rosgraph.network.get_address_override(),
        settings.address, *settings.host_names.split(),
    }
    return {name.lower() for name in names if name}


def leave_simulated_time() -> None:
    """Use the wall clock and unsubscribe from /clock, to which rospy subscribes by itself: this node needs no ROS time.
    """
    rospy.rostime.switch_to_wallclock()
    subscriber = getattr(rospy.impl.simtime, "_clock_sub", None)
    if subscriber is not None:
        subscriber.unregister()


def keep(tokens: Tokens) -> str:
    """Write the tokens to a file readable only by its owner; return its path, empty where there are no tokens."""
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
