"""Who opens connections by the thousand takes no file from the node, and is let go of."""

import asyncio
import socket
import threading
import urllib.request

import pytest

pytest.importorskip("tornado")

import tornado.netutil  # noqa: E402
import tornado.web  # noqa: E402
from ros_testing import wait_until  # noqa: E402

from mbf_relay.ros.web import node  # noqa: E402
from mbf_relay.view.parameters import WebViewParameters  # noqa: E402
from mbf_relay.view.rights import is_own_host  # noqa: E402


class Hello(tornado.web.RequestHandler):
    """The page."""

    def get(self):
        """Say hello."""
        self.write("hello")


@pytest.fixture
def port():
    loop = asyncio.new_event_loop()
    (listening,) = tornado.netutil.bind_sockets(0, "127.0.0.1")

    def serve():
        asyncio.set_event_loop(loop)
        server = node.LimitedServer(tornado.web.Application([("/", Hello)], log_function=lambda handler: None))
        server.add_sockets([listening])
        loop.run_forever()
        server.stop()
        loop.run_until_complete(server.close_all_connections())

    thread = threading.Thread(target=serve)
    thread.start()
    yield listening.getsockname()[1]
    loop.call_soon_threadsafe(loop.stop)
    thread.join()
    loop.close()


def page(port):
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=10.0) as answer:  # noqa: S310 (this test's own)
        return answer.read()


def test_a_page_is_there_again_once_a_crowd_that_says_nothing_is_gone(port, monkeypatch):
    monkeypatch.setattr(node, "MOST_CONNECTIONS", 3)
    silent = [socket.create_connection(("127.0.0.1", port), 10.0) for _ in range(3)]
    refused = [socket.create_connection(("127.0.0.1", port), 10.0) for _ in range(20)]
    assert [connection.recv(1) for connection in refused] == [b""] * 20
    for connection in (*silent, *refused):
        connection.close()

    def is_served():
        try:
            return page(port) == b"hello"
        except OSError:
            return False

    wait_until(is_served, "the page, once there is room")


def names_of(monkeypatch, host, ros_hostname):
    monkeypatch.setattr(node.socket, "gethostname", lambda: host)
    monkeypatch.setattr(node.socket, "getfqdn", lambda: host)
    monkeypatch.setenv("ROS_HOSTNAME", ros_hostname)
    return node.own_names(WebViewParameters())


def test_a_phone_finds_the_robot_by_the_name_that_its_network_has_for_it(monkeypatch):
    names = names_of(monkeypatch, "burger", "burger.lab.example")
    for host in ("burger:8642", "Burger.local:8642", "burger.lab.example:8642", "192.168.0.7:8642"):
        assert is_own_host(host, names), host
    assert not is_own_host("evil.local:8642", names)


@pytest.mark.parametrize("ros_hostname, shown", [("192.168.0.7", "192.168.0.7"), ("127.0.0.1", "burger")])
def test_the_address_in_the_log_is_the_one_that_ros_has_for_this_machine(monkeypatch, ros_hostname, shown):
    names_of(monkeypatch, "burger", ros_hostname)
    everywhere = "0.0.0.0"  # noqa: S104
    server = node.Server(WebViewParameters(address=everywhere, port=0, view_token="see", drive_token="steer"))
    try:
        assert server.addresses() == [
            f"http://{shown}:{server.port}/#token={token}  (to {right})" for token, right in (
                ("steer", "drive"), ("see", "look"))]
    finally:
        for listening in server._sockets:
            listening.close()
        server._loop.close()
