"""Who connects to a node and says nothing, or nonsense, keeps nobody else out."""

import errno
import io
import socket
import struct
import threading
from types import SimpleNamespace
from xmlrpc.client import ServerProxy

import pytest
import rospy
from ros_testing import wait_until
from rosgraph.network import ROSHandshakeException, read_ros_handshake_header
from rosgraph.xmlrpc import (
    SilenceableXMLRPCRequestHandler,
    ThreadingXMLRPCServer,
    XmlRpcNode,
)
from rospy.impl import tcpros_service
from rospy.impl.tcpros_base import TCPROSServer, TCPROSTransport, TCPServer
from rospy.impl.tcpros_service import ServiceImpl, TCPService
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from mbf_relay.ros.common.rospy_patches import accepting


def words(**fields):
    """Return what a node says of itself when it connects."""
    lines = b"".join(struct.pack("<I", len(line)) + line for line in (f"{k}={v}".encode() for k, v in fields.items()))
    return struct.pack("<I", len(lines)) + lines


class Node:
    """Takes connections, as a publisher does."""

    def __init__(self, monkeypatch):
        monkeypatch.setattr(TCPROSServer, "_tcp_server_callback", accepting.start_handshake)
        monkeypatch.setenv("ROS_IP", "127.0.0.1")
        self.refusals, self.heard, self.limits = [], [], []
        monkeypatch.setattr(accepting.rospy, "logwarn_throttle", lambda period, text: self.refusals.append(text))
        self.server = TCPROSServer()
        self.server.topic_connection_handler = self._take
        self.server.start_server()
        self._connections = []

    def _take(self, connection, _address, header):
        self.limits.append(connection.gettimeout())
        if header["topic"] == "/nothing":
            return "no such topic"
        self.heard.append(header["callerid"])
        return ""

    def connect(self, text=b""):
        connection = socket.create_connection(self.server.get_address(), 10.0)
        self._connections.append(connection)
        connection.sendall(text)
        return connection

    def hears_of(self, name):
        self.connect(words(callerid=name, topic="/cmd_vel"))
        wait_until(lambda: name in self.heard, f"the node to hear of {name}")

    def close(self):
        for connection in self._connections:
            connection.close()
        self.server.shutdown()
        wait_until(lambda: not any(thread.name == "TCPROS handshake" for thread in threading.enumerate()),
                   "nobody to be heard out any more")


@pytest.fixture
def node(monkeypatch):
    made = Node(monkeypatch)
    yield made
    made.close()


def test_a_robot_is_not_left_standing_by_somebody_who_connects_and_says_nothing(node):
    for _ in range(20):
        node.connect()
    node.connect(b"\x20\x00")  # began, and says no more
    node.hears_of("/velocity_guard")
    assert node.limits == [None], "a subscriber may be silent for as long as it likes"


def test_strangers_who_listen_and_never_read_leave_a_node_files_and_threads(node, monkeypatch):
    """Each held a thread and a file; with a thousand nobody could ask the node for anything any more."""
    topics = SimpleNamespace(pubs={"/tf": SimpleNamespace(connections=node.heard)})
    monkeypatch.setattr(accepting, "get_topic_manager", lambda: topics)
    for number in range(accepting.MOST_SUBSCRIBERS):
        node.hears_of(f"/silent{number}")
    with node.connect(words(callerid="/one_more", topic="/tf")) as connection:
        connection.settimeout(20.0)
        assert "400 connections" in read_ros_handshake_header(connection, io.BytesIO(), 65536)["error"]
    node.heard.pop()
    node.hears_of("/velocity_guard")


@pytest.mark.parametrize("text", [
    b"\x00" * 8, b"\xff" * 8, b"GET / HTTP/1.1\r\n\r\n", words(callerid="/x"), words(topic="/nothing", callerid="/x"),
    words(topic="/cmd_vel"), struct.pack("<II", 8, 0) + b"....", bytes(range(64)),
])
def test_who_talks_nonsense_is_refused_in_one_line(node, text):
    connection = node.connect(text)
    while connection.recv(4096):  # it ends: what it was told first is its own business
        pass
    wait_until(lambda: len(node.refusals) == 1, "a line about it")
    assert "\n" not in node.refusals[0] and len(node.refusals[0]) < 300
    node.hears_of("/velocity_guard")


def test_a_connection_that_its_subscriber_has_given_up_does_not_take_the_place_of_its_next_one(node):
    """A drive was recorded without the robot's poses: the publisher had kept the connection that was closed already."""
    given_up, other = socket.socketpair()
    with other:
        other.sendall(words(callerid="/recorder", topic="/tf"))
    node.hears_of("/recorder")
    accepting.start_handshake(node.server, given_up, ("127.0.0.1", 0))
    wait_until(lambda: given_up.fileno() == -1, "the closed connection to be let go")
    assert node.heard == ["/recorder"] and not node.refusals


def test_who_connects_while_a_topic_is_advertised_is_told_of_to_the_one_who_asked(node, monkeypatch):
    """A costmap that is sent to new subscribers alone never came to RViz."""
    connection, other = socket.socketpair()
    comes = threading.Thread(target=accepting._do_handshake, args=(node.server, connection, ("127.0.0.1", 0)))
    accepting._handshakes.acquire()
    early = []

    def as_rospy(*_arguments):
        comes.start()
        comes.join(0.3)  # where it does not wait, it has been handed over by then
        early.extend(node.heard)

    monkeypatch.setattr(accepting, "_make_as_rospy", as_rospy)
    with connection, other:
        other.sendall(words(callerid="/rviz", topic="/costmap"))
        accepting.make_publisher(None, "/costmap")
        comes.join()
    assert not early and node.heard == ["/rviz"]


def test_a_crowd_that_says_nothing_takes_no_more_files_than_a_few(node, monkeypatch):
    monkeypatch.setattr(accepting, "_handshakes", threading.Semaphore(3))
    silent = [node.connect() for _ in range(3)]
    wait_until(lambda: not accepting._handshakes._value, "all of them to be heard out")
    assert [node.connect().recv(1) for _ in range(20)] == [b""] * 20, "each is let go"
    for connection in silent:
        connection.close()
    wait_until(lambda: accepting._handshakes._value == 3, "all of them to have left")
    node.hears_of("/velocity_guard")


def test_first_words_of_gigabytes_are_not_waited_for(node):
    connection = node.connect(struct.pack("<I", 2 ** 31))
    assert connection.recv(1) == b""
    wait_until(lambda: str(2 ** 31) in "".join(node.refusals), "a line about it")


def test_who_says_nothing_in_time_is_let_go(node, monkeypatch):
    monkeypatch.setattr(accepting, "PATIENCE", 0.01)
    assert node.connect().recv(1) == b""
    wait_until(lambda: "said nothing" in "".join(node.refusals), "a line about it")


def test_who_asks_for_what_there_is_not_is_told_so(node):
    connection = node.connect(words(topic="/nothing", callerid="/x"))
    assert read_ros_handshake_header(connection, io.BytesIO(), 4096) == {"error": "no such topic"}


def test_who_says_a_letter_at_a_time_is_not_heard_out_for_longer_than_others(monkeypatch):
    monkeypatch.setattr(accepting, "PATIENCE", 0.0)
    connection, other = socket.socketpair()
    with connection, other:
        other.sendall(words(callerid="/a", topic="/cmd_vel"))
        with pytest.raises(ROSHandshakeException, match="said nothing of itself within"):
            accepting.read_handshake(connection)


class NoThread:
    """What a process has that may start no more threads."""

    def __init__(self, **_):
        pass

    def start(self):
        raise RuntimeError("can't start new thread")


def test_a_node_that_could_start_no_thread_for_a_while_hears_others_afterwards(node, monkeypatch):
    """The thread that takes connections ended of it, and the node was deaf for good."""
    monkeypatch.setattr(accepting, "_handshakes", threading.Semaphore(1))
    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(accepting.threading, "Thread", NoThread)
        assert [node.connect().recv(1) for _ in range(3)] == [b""] * 3, "each is let go"
    node.hears_of("/velocity_guard")


def test_many_who_come_at_once_are_not_sent_away_for_a_second(monkeypatch):
    """A guard that came back while a stranger knocked without end was heard a second later each time it tried."""
    come = threading.Event()
    monkeypatch.setattr(accepting, "_accept_as_rospy", lambda _server: come.wait(60.0))
    monkeypatch.setattr(TCPServer, "run", accepting.accept_all)
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    server, connections = TCPROSServer(), []
    server.start_server()
    try:
        for _ in range(60):
            connections.append(socket.create_connection(server.get_address(), 10.0))
    finally:
        server.tcp_ros_server.is_shutdown = True
        come.set()
        for connection in connections:
            connection.close()
        server.shutdown()


def test_a_node_that_had_no_file_left_for_a_while_takes_connections_afterwards(monkeypatch):
    monkeypatch.setattr(accepting, "PAUSE", 0.0)
    comings = [OSError(errno.EMFILE, "too many open files"), ("connection", "address"), OSError(errno.EBADF, "closed")]
    taken = []

    def accept():
        come = comings.pop(0)
        server.is_shutdown = not comings
        if isinstance(come, OSError):
            raise come
        return come

    server = SimpleNamespace(
        is_shutdown=False, port=0, server_sock=SimpleNamespace(accept=accept, listen=lambda _most: None),
        inbound_handler=lambda *come: taken.append(come))
    accepting.accept_all(server)
    assert taken == [("connection", "address")]


def test_a_node_that_could_start_no_thread_for_a_while_answers_in_xml_rpc_afterwards(monkeypatch):
    monkeypatch.setattr(accepting, "_xmlrpc_calls", threading.Semaphore(1))
    with monkeypatch.context() as short_of_threads:
        short_of_threads.setattr(accepting.threading, "Thread", NoThread)
        server = SimpleNamespace(
            block_on_close=False, daemon_threads=True, process_request_thread=None, _threads=[],
            shutdown_request=lambda connection: None)
        for _ in range(3):
            with pytest.raises(RuntimeError):  # its caller knows what to do
                accepting.answer_xmlrpc(server, None, ("", 0))
    assert accepting._xmlrpc_calls._value == 1


class Slave:
    """Answers XML-RPC, as a node does."""

    def getPid(self, _caller):  # noqa: N802 (the slave API's name)
        return 1, "", 7


def test_threads_do_not_pile_up_where_cables_are_cut_in_xml_rpc(monkeypatch):
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    monkeypatch.setattr(TCPServer, "run", TCPServer.run)
    monkeypatch.setattr(TCPROSServer, "_tcp_server_callback", TCPROSServer._tcp_server_callback)
    monkeypatch.setattr(SilenceableXMLRPCRequestHandler, "timeout", None)
    monkeypatch.setattr(ServiceImpl, "handle", ServiceImpl.handle)
    monkeypatch.setattr(rospy.Publisher, "__init__", rospy.Publisher.__init__)
    monkeypatch.setattr(ThreadingXMLRPCServer, "request_queue_size", ThreadingXMLRPCServer.request_queue_size)
    monkeypatch.setattr(accepting, "LONGEST_SILENCE", 0.01)
    monkeypatch.setattr(accepting, "_xmlrpc_calls", threading.Semaphore(3))
    for name in ("process_request", "process_request_thread"):
        monkeypatch.setattr(ThreadingXMLRPCServer, name, getattr(ThreadingXMLRPCServer, name))
    accepting.apply_patches()
    before = threading.active_count()
    node = XmlRpcNode(rpc_handler=None)
    node._run_init()
    node.server.register_instance(Slave())
    serving = threading.Thread(target=node.server.serve_forever, args=(0.01,))
    serving.start()
    try:
        silent = [socket.create_connection(("127.0.0.1", node.port), 10.0) for _ in range(20)]
        assert [connection.recv(1) for connection in silent] == [b""] * 20, "each is let go"
        wait_until(lambda: threading.active_count() <= before + 4, "the threads of those let go to end")
        wait_until(lambda: accepting._xmlrpc_calls._value == 3, "all of them to have left")
        with ServerProxy(node.uri) as proxy:
            assert proxy.getPid("/master")[2] == 7
            wait_until(lambda: threading.active_count() <= before + 1, "a client that is silent to be let go")
            assert proxy.getPid("/master")[2] == 7, "a client that was let go connects anew"
    finally:
        node.server.shutdown()
        serving.join()
        node.server.server_close()


class Paper(ServiceImpl):
    """A service that says yes, without a node."""

    def __init__(self):
        self.resolved_name, self.seq, self.response_class = "/clear", 0, TriggerResponse
        self.handler = lambda _request: TriggerResponse(success=True)
        self._threads, self.ours = [], []

    def connect(self):
        """Return a client's end of a new connection."""
        mine, other = socket.socketpair()
        connection = TCPROSTransport(TCPService("/clear", Trigger), "/clear", header={})
        connection.set_socket(mine, "/client")
        self._threads.append(threading.Thread(target=self.handle, args=(connection, {})))
        self._threads[-1].start()
        self.ours.append(other)
        return other

    def answers(self, connection):
        request = io.BytesIO()
        TriggerRequest().serialize(request)
        connection.sendall(struct.pack("<I", len(request.getvalue())) + request.getvalue())
        return connection.recv(1) == b"\x01"

    def alive(self):
        return sum(thread.is_alive() for thread in self._threads)

    def close(self):
        for connection in self.ours:
            connection.close()
        for thread in self._threads:
            thread.join(30.0)


def test_threads_do_not_pile_up_where_strangers_connect_to_a_service_and_ask_nothing(monkeypatch):
    """Each held a thread and a file for good; with no file left a velocity_guard that came back found no server."""
    monkeypatch.setattr(ServiceImpl, "handle", accepting.serve)
    monkeypatch.setattr(accepting, "MOST_AT_A_TIME", 3)
    errors, service = [], Paper()
    monkeypatch.setattr(tcpros_service, "logerr", errors.append)
    try:
        silent = []
        for _ in range(20):
            silent.append(service.connect())
            wait_until(lambda: service.alive() <= 3, "the oldest to be let go")
        assert [connection.recv(1) for connection in silent[:17]] == [b""] * 17
        assert service.answers(service.connect()), "who comes then is served"
    finally:
        service.close()
    assert service.alive() == 0 and not accepting._served and errors == []


class WatchedLock:
    """A lock that tells how many have asked for it."""

    def __init__(self):
        self.asked, self._lock = [], threading.Lock()

    def __enter__(self):
        self.asked.append(threading.get_ident())
        self._lock.acquire()

    def __exit__(self, *_error):
        self._lock.release()


def test_a_topic_that_waits_for_a_master_that_hangs_keeps_nobody_from_the_wheels_velocities(node, monkeypatch):
    answered = threading.Event()

    def take(_connection, _address, header):
        if header["topic"] == "/costmap":
            answered.wait()
        return node._take(_connection, _address, header)

    node.server.topic_connection_handler = take
    try:
        node.connect(words(topic="/costmap", callerid="/rviz"))
        node.connect(words(topic="/cmd_vel", callerid="/wheels"))
        wait_until(lambda: node.heard == ["/wheels"], "the wheels")
    finally:
        answered.set()
    wait_until(lambda: node.heard == ["/wheels", "/rviz"], "both")
    wait_until(lambda: not accepting._handler_locks, "no lock left")


def test_two_at_a_time_are_handled_one_after_the_other(node, monkeypatch):
    inside, most, handling = [], [], WatchedLock()
    monkeypatch.setattr(accepting._handler_locks, "of", {"/a": handling}.get)

    def take(_connection, _address, header):
        inside.append(header)
        wait_until(lambda: len(handling.asked) == 4, "all four at the door")
        most.append(len(inside))
        inside.pop()

    node.server.topic_connection_handler = take
    for _ in range(4):
        node.connect(words(topic="/a", callerid="/b"))
    wait_until(lambda: len(most) == 4, "all four")
    assert set(most) == {1}
