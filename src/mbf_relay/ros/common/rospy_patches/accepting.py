"""Incoming connections: each TCPROS handshake in a thread of its own, with timeouts and limits.

rospy reads the handshake header of each connection in the one thread that accepts connections, without a timeout. A
peer that connects and sends nothing, as a port scan or a subscriber whose cable was cut, blocks all others for good: a
velocity_guard that restarted after that received no velocities, and the robot stood still. On the node's XML-RPC port
each such connection holds a thread for good. Once they use up the process' file descriptors (usually a thousand), rospy
tries to accept again and again without a pause.

rospy's subscribers may connect twice, closing the first connection, and a publisher keeps only the one it heard last.
With a thread each, that could be the closed one: the subscriber then never got a message.

A publisher is advertised before it has its SubscribeListener and its latch, and whoever connects in between is not told
of: a costmap that is sent to new subscribers alone never came.
"""

from __future__ import annotations

import collections
import errno
import select
import socket
import struct
import threading
import time
from socketserver import ThreadingMixIn
from typing import Any, Deque, Dict, Mapping, Optional, Tuple

import rospy
from rosgraph.network import ROSHandshakeException, decode_ros_handshake_header, write_ros_handshake_header
from rosgraph.xmlrpc import SilenceableXMLRPCRequestHandler, ThreadingXMLRPCServer
from rospy.impl.registration import get_topic_manager
from rospy.impl.tcpros_base import TCPROSServer, TCPServer
from rospy.impl.tcpros_service import ServiceImpl

from mbf_relay.ros.common.rospy_patches.named_locks import NamedLocks

PATIENCE = 5.0
"""Wall seconds for the handshake header, which nodes send as soon as they are connected."""
LONGEST_HANDSHAKE = 1 << 20
"""Largest size (bytes) of a handshake header; with the definition of the longest message it has some ten thousand."""
MOST_AT_A_TIME = 200
"""Largest number of handshakes at a time, and of XML-RPC calls; further connections are closed. Also of connections to
services, of which the oldest is closed, since some clients keep theirs open for good."""
MOST_SUBSCRIBERS = 400
"""Largest number of connections to a node's topics, each of which takes a thread, a file descriptor and 0.2 MiB.
Further ones are refused, rather than old ones closed, since rospy's subscribers do not reconnect. Together with
MOST_AT_A_TIME these stay within the usual thousand file descriptors. All nodes of a fleet may subscribe to one /clock.
"""
WAITING_AT_MOST = 128
"""The listen(2) backlog. rospy's is 5: with many nodes starting at once, others had to retry after a second."""
LONGEST_SILENCE = 60.0
"""Wall seconds of silence after which an XML-RPC connection is closed; clients reconnect when they need it."""
OUT_OF_FILES, PAUSE = (errno.EMFILE, errno.ENFILE), 0.1
"""Errors of accept(2) where there are no file descriptors left, and wall seconds until the next attempt."""
_LENGTH = struct.Struct("<I")
_accept_as_rospy, _serve_as_rospy, _make_as_rospy = TCPServer.run, ServiceImpl.handle, rospy.Publisher.__init__
_handshakes, _xmlrpc_calls = threading.Semaphore(MOST_AT_A_TIME), threading.Semaphore(MOST_AT_A_TIME)
_served: Deque[Any] = collections.deque()  # connections to services, oldest first
_served_lock = threading.Lock()  # guards it
# rospy's connection handlers are not thread-safe. One lock for each topic or service, as a handler may take long, e.g.
# to ask the master; also held while a publisher is made. Taken before any of rospy's locks. Their names come from
# outside, hence NamedLocks.
_handler_locks = NamedLocks()


def apply_patches() -> None:
    """Apply this module's patches to rospy; before rospy.init_node."""
    TCPServer.run = accept_all
    TCPROSServer._tcp_server_callback = start_handshake
    SilenceableXMLRPCRequestHandler.timeout = LONGEST_SILENCE
    ThreadingXMLRPCServer.request_queue_size = WAITING_AT_MOST
    ThreadingXMLRPCServer.process_request = answer_xmlrpc
    ThreadingXMLRPCServer.process_request_thread = _answer_xmlrpc
    ServiceImpl.handle = serve
    rospy.Publisher.__init__ = make_publisher


def make_publisher(publisher: Any, name: str, *arguments: Any, **options: Any) -> None:
    """Make a publisher as its class does, and have subscribers wait until it is complete; replaces its __init__."""
    with _handler_locks.of(rospy.resolve_name(name)):
        _make_as_rospy(publisher, name, *arguments, **options)


def accept_all(server: Any) -> None:
    """Accept connections as TCPServer.run does, which ends for good when file descriptors run out; replaces it."""
    server.server_sock.listen(WAITING_AT_MOST)
    while not server.is_shutdown:
        try:
            _accept_as_rospy(server)
        except OSError as error:
            if error.errno not in OUT_OF_FILES:
                raise
            time.sleep(PAUSE)


def start_handshake(server: Any, connection: socket.socket, address: Tuple[str, int]) -> None:
    """Start a thread for a connection's handshake; replaces TCPROSServer._tcp_server_callback."""
    if not _handshakes.acquire(blocking=False):
        connection.close()
        return
    try:
        threading.Thread(
            target=_do_handshake, args=(server, connection, address), name="TCPROS handshake", daemon=True).start()
    except RuntimeError:  # no thread can be started now
        _handshakes.release()
        connection.close()


def answer_xmlrpc(server: Any, connection: socket.socket, address: Tuple[str, int]) -> None:
    """Serve an XML-RPC connection in a thread, MOST_AT_A_TIME at most; replaces process_request of rospy's server."""
    if not _xmlrpc_calls.acquire(blocking=False):
        server.shutdown_request(connection)
        return
    try:
        ThreadingMixIn.process_request(server, connection, address)
    except RuntimeError:
        _xmlrpc_calls.release()
        raise


def _answer_xmlrpc(server: Any, connection: socket.socket, address: Tuple[str, int]) -> None:
    try:
        ThreadingMixIn.process_request_thread(server, connection, address)
    finally:
        _xmlrpc_calls.release()


def serve(service: Any, connection: Any, header: Mapping[str, str]) -> None:
    """Serve a connection to a service as ServiceImpl.handle does, which it replaces; closes the oldest of too many."""
    with _served_lock:
        _served.append(connection)
        oldest = _served.popleft() if len(_served) > MOST_AT_A_TIME else None
    if oldest is not None:
        _shut_down(oldest.socket)
    try:
        if _sends_request(connection.socket):
            _serve_as_rospy(service, connection, header)
        else:
            connection.close()
    finally:
        with _served_lock:
            if connection in _served:
                _served.remove(connection)


def _sends_request(connection: socket.socket) -> bool:
    """Wait for a service request; return False where the client disconnects without one, for which rospy logs an error.
    """
    try:
        return bool(connection.recv(1, socket.MSG_PEEK))
    except OSError:
        return False


def _shut_down(connection: Optional[socket.socket]) -> None:
    """Shut a connection down, so that the thread that reads from it ends."""
    try:
        if connection is not None:
            connection.shutdown(socket.SHUT_RDWR)
    except OSError:
        pass  # closed already


def _do_handshake(server: Any, connection: socket.socket, address: Tuple[str, int]) -> None:
    try:
        header = read_handshake(connection)
        if header is None:
            connection.close()
            return
        with _handler_locks.of(header.get("topic") or header.get("service", "")):
            trouble = _hand_over(server, connection, address, header)
        if trouble:
            write_ros_handshake_header(connection, {"error": trouble})
    except Exception as error:  # any error of a peer's input concerns this connection only
        trouble = str(error)
    finally:
        _handshakes.release()
    if trouble:
        connection.close()
        if not rospy.core.is_shutdown_requested():
            rospy.logwarn_throttle(PATIENCE, f"a connection from {address[0]} was refused: {trouble[:200]}")


def read_handshake(connection: socket.socket) -> Optional[Dict[str, str]]:
    """Return a connection's handshake header, None where the peer closed it without sending anything.

    The socket is blocking without a timeout again afterwards.

    Raises:
        ROSHandshakeException: The header is late, incomplete, too long or malformed.
    """
    end, read = time.monotonic() + PATIENCE, b""
    while len(read) < _LENGTH.size or len(read) < _LENGTH.size + _LENGTH.unpack_from(read)[0]:
        if len(read) >= _LENGTH.size and _LENGTH.unpack_from(read)[0] > LONGEST_HANDSHAKE:
            raise ROSHandshakeException(
                f"its first words are {_LENGTH.unpack_from(read)[0]} bytes; at most {LONGEST_HANDSHAKE}")
        left = end - time.monotonic()
        try:
            if left <= 0.0:
                raise socket.timeout
            connection.settimeout(left)
            more = connection.recv(4096)
        except socket.timeout as error:
            raise ROSHandshakeException(f"it said nothing of itself within {PATIENCE:g} s") from error
        if not more and not read:
            return None
        if not more:
            raise ROSHandshakeException("it ended before it had said what it wants")
        read += more
    connection.settimeout(None)
    header: Dict[str, str] = decode_ros_handshake_header(read)
    return header


def has_hung_up(connection: socket.socket) -> bool:
    """Return whether the peer has closed its end of a connection.

    Raises:
        ValueError: The connection is closed at this end.
    """
    poll = select.poll()
    poll.register(connection, select.POLLRDHUP)
    return bool(poll.poll(0))


def subscriber_connections() -> int:
    """Return the number of connections to topics that this node publishes."""
    return sum(len(topic.connections) for topic in list(get_topic_manager().pubs.values()))


def _hand_over(server: Any, connection: socket.socket, address: Tuple[str, int], header: Dict[str, str]) -> str:
    """Pass a connection to rospy's topic or service handler; return why it is refused, empty where it is not."""
    if "topic" in header:
        if has_hung_up(connection):
            connection.close()
            return ""
        if subscriber_connections() >= MOST_SUBSCRIBERS:
            return f"{MOST_SUBSCRIBERS} connections listen to this node's topics already"
        handle = server.topic_connection_handler
    elif "service" in header:
        handle = server.service_connection_handler
    else:
        return "no topic or service name detected"
    trouble = handle(connection, address, header)
    return "node shutting down" if trouble and rospy.core.is_shutdown_requested() else trouble or ""
