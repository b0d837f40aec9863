"""No message is lost between two connections with the same publisher, nor all of them for one that was refused."""

import contextlib
import io
import socket
import threading
from types import SimpleNamespace

import pytest
import rospy
from rosgraph.network import read_ros_handshake_header, write_ros_handshake_header
from rospy.impl import tcpros_base, tcpros_pubsub
from std_msgs.msg import String

from mbf_relay.ros.common.rospy_patches import connecting


def test_a_goal_sent_on_the_first_connection_is_not_lost_to_a_second(monkeypatch):
    connected, made = set(), []
    both = threading.Barrier(2)

    def as_rospy(_handler, topic, publisher):
        if (topic, publisher) not in connected:
            try:
                both.wait(0.3)  # where two are at it, both have looked
            except threading.BrokenBarrierError:
                pass
            connected.add((topic, publisher))
            made.append((topic, publisher))
        return 1, "connected", 0

    monkeypatch.setattr(connecting, "_connect_as_rospy", as_rospy)
    threads = [threading.Thread(target=connecting.connect_topic, args=(None, "/goal", "client")) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert made == [("/goal", "client")] and not connecting._locks


def test_the_only_map_is_not_lost_on_a_subscriber_that_has_no_callback_yet(monkeypatch):
    """rospy connects as soon as the master has answered: amcl, or RViz's costmap, waited for a map for good."""
    order = []
    connecting_thread = threading.Thread(target=connecting.open_connection, args=(None, "/map"))

    def as_rospy(*_arguments):
        connecting_thread.start()
        connecting_thread.join(0.3)  # where it does not wait, it has connected by then
        order.append("complete")

    monkeypatch.setattr(connecting, "_make_as_rospy", as_rospy)
    monkeypatch.setattr(connecting, "_open_as_rospy", lambda *_what: order.append("connected"))
    connecting.make_subscriber(None, "/map")
    connecting_thread.join()
    assert order == ["complete", "connected"] and not connecting._making


def test_a_driver_that_takes_its_topic_back_and_offers_it_again_at_once_is_heard(monkeypatch):
    """The master told of it before its connection's end was noticed, which was left alone: the guard heard no more."""
    ours, theirs = socket.socketpair()
    kept = SimpleNamespace(endpoint_id="driver", socket=ours, protocol=object())
    connections, looked, made = [kept], threading.Event(), []
    manager = SimpleNamespace(get_subscriber_impl=lambda topic: SimpleNamespace(connections=list(connections)))
    monkeypatch.setattr(connecting, "get_topic_manager", lambda: manager)
    monkeypatch.setattr(connecting.time, "sleep", lambda _pause: looked.set() or real_pause.wait(0.01))
    monkeypatch.setattr(connecting, "_connect_as_rospy", lambda *what: connections or made.append(what))
    real_pause = threading.Event()

    connecting.connect_topic("handler", "/cmd_vel_raw", "driver")
    assert not made and not looked.is_set(), "what is connected is left alone"
    theirs.sendall(b"a last velocity")
    theirs.close()
    again = threading.Thread(target=connecting.connect_topic, args=("handler", "/cmd_vel_raw", "driver"))
    again.start()
    assert looked.wait(10.0)
    ours.close()  # as rospy does on the way: the socket, then what is kept of it, then the place in the list
    kept.socket = kept.protocol = None
    connections.clear()
    again.join()
    assert made == [("handler", "/cmd_vel_raw", "driver")]


def test_a_publisher_that_does_not_answer_keeps_no_other_waiting(monkeypatch):
    dead, heard = threading.Event(), threading.Event()

    def as_rospy(_handler, _topic, publisher):
        if publisher == "dead":
            dead.wait(10.0)
        else:
            heard.set()

    monkeypatch.setattr(connecting, "_connect_as_rospy", as_rospy)
    waiting = threading.Thread(target=connecting.connect_topic, args=(None, "/goal", "dead"))
    waiting.start()
    try:
        connecting.connect_topic(None, "/goal", "client")
        assert heard.is_set()
    finally:
        dead.set()
        waiting.join()


@contextlib.contextmanager
def publisher(*headers):
    """Serve /goal: answer one connection after the other with the headers, and send "go" where one is no refusal."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(10.0)

        def serve():
            for header in headers:
                connection, _ = server.accept()
                with connection:
                    read_ros_handshake_header(connection, io.BytesIO(), 65536)
                    write_ros_handshake_header(connection, header)
                    if "error" not in header:
                        message = io.BytesIO()
                        String("go").serialize(message)
                        connection.sendall(len(message.getvalue()).to_bytes(4, "little") + message.getvalue())
                        connection.recv(1)  # until who listens has closed it

        serving = threading.Thread(target=serve)
        serving.start()
        try:
            yield server.getsockname()[1]
        finally:
            serving.join()


REFUSAL = {"error": "received a connection for a nonexistent topic [/goal] from [/relay]"}
ACCEPTANCE = {"type": String._type, "md5sum": String._md5sum, "callerid": "/rviz"}


@pytest.fixture
def subscriber(monkeypatch):
    """A connection of /goal that is not made yet."""
    monkeypatch.setattr(tcpros_base, "_is_use_tcp_keepalive", lambda: True)  # or it asks a master
    protocol = tcpros_pubsub.TCPROSSub("/goal", String, queue_size=1)
    connection = tcpros_base.TCPROSTransport(protocol, "/goal")
    yield connection
    connection.close()


def test_a_click_is_heard_after_a_refusal_while_rviz_set_up_its_tools(monkeypatch, subscriber):
    heard, pauses = [], []
    monkeypatch.setattr(connecting.time, "sleep", pauses.append)
    monkeypatch.setattr(tcpros_pubsub, "check_if_still_publisher", lambda topic, _uri: topic == "/goal")

    def receive(messages, connection):
        heard.extend(message.data for message in messages)
        connection.close()

    with publisher(REFUSAL, REFUSAL, ACCEPTANCE) as port:
        connecting.connect_and_receive(subscriber, "127.0.0.1", port, "http://rviz", receive, "/goal")
    assert heard == ["go"] and pauses == [0.1, 0.2]


def test_a_topic_that_was_refused_and_taken_back_counts_as_no_connection_when_it_comes_back(monkeypatch, subscriber):
    monkeypatch.setattr(connecting.time, "sleep", lambda _pause: None)
    monkeypatch.setattr(tcpros_pubsub, "check_if_still_publisher", lambda _topic, _uri: False)
    closed = []
    subscriber.set_cleanup_callback(closed.append)
    with publisher(REFUSAL) as port:
        connecting.connect_and_receive(subscriber, "127.0.0.1", port, "http://rviz", None, "/goal")
    assert closed == [subscriber]


def test_a_publisher_that_is_gone_is_not_asked_again(monkeypatch, subscriber):
    monkeypatch.setattr(connecting.time, "sleep", lambda _pause: pytest.fail("nobody listens there any more"))
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    connecting.connect_and_receive(subscriber, "127.0.0.1", port, "http://rviz", None, "/goal")
    assert subscriber.done


def test_who_stops_listening_while_refused_is_not_connected_any_more(monkeypatch, subscriber):
    monkeypatch.setattr(connecting.time, "sleep", lambda _pause: subscriber.close())
    monkeypatch.setattr(tcpros_pubsub, "check_if_still_publisher", lambda _topic, _uri: True)
    with publisher(REFUSAL) as port:
        connecting.connect_and_receive(subscriber, "127.0.0.1", port, "http://rviz", None, "/goal")
    assert subscriber.done and subscriber.socket is None


def test_a_node_connects_so(monkeypatch):
    monkeypatch.setattr(tcpros_pubsub, "robust_connect_subscriber", tcpros_pubsub.robust_connect_subscriber)
    monkeypatch.setattr(connecting.ROSHandler, "_connect_topic", connecting.ROSHandler._connect_topic)
    monkeypatch.setattr(rospy.Subscriber, "__init__", rospy.Subscriber.__init__)
    monkeypatch.setattr(tcpros_pubsub.TCPROSHandler, "create_transport", tcpros_pubsub.TCPROSHandler.create_transport)
    connecting.apply_patches()
    assert tcpros_pubsub.robust_connect_subscriber is connecting.connect_and_receive
    assert connecting.ROSHandler._connect_topic is connecting.connect_topic
