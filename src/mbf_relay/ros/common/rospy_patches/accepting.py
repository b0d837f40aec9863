"""Connections that come to a node, each heard out in a thread of its own.

rospy waits for the first words of whoever connects in the one thread that takes connections, for as long as that takes.
Somebody who connected and said nothing, be it a look for open ports or a subscriber whose cable was cut, kept everybody
else out for good: a velocity_guard that came back after that heard of no velocity, and the robot stood. On a node's
other port, that of XML-RPC, each such connection held a thread for good. And a thousand at a time are all the files a
process may usually open: then a node looks again and again who waits, without a pause.
"""

from __future__ import annotations

import collections
import errno
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
"""Wall seconds for the first words, which nodes send as soon as they are connected."""
LONGEST = 1 << 20
"""Bytes of the first words; a definition of the longest message has some ten thousand."""
MOST_AT_A_TIME = 200
"""Connections that are heard out, and as many that are answered in XML-RPC; whoever else comes meanwhile is let go. Of
as many to services the oldest is let go: some clients keep theirs for good."""
MOST_LISTENERS = 400
"""Connections to a node's topics, each of which holds a thread, a file and 0.2 MiB; who comes then is refused, since
rospy's subscribers never come back where they are let go. A fleet's nodes all listen to one /clock; with as many as are
heard out, answered and served these are the thousand files a process may usually open."""
WAITING_AT_MOST = 128
"""Connections that the system holds until the node takes them. It held rospy's five: whoever else came at that moment
tried again a second later, as where many nodes come at once, or a stranger knocks without end."""
LONGEST_SILENCE = 60.0
"""Wall seconds after which an XML-RPC connection is closed; who needs it connects anew."""
OUT_OF_FILES, PAUSE = (errno.EMFILE, errno.ENFILE), 0.1
"""What the system says where no file is left for a connection, and wall seconds until the next look whether one is."""
_LENGTH = struct.Struct("<I")
_take_as_rospy, _serve_as_rospy = TCPServer.run, ServiceImpl.handle
_unheard, _calling = threading.Semaphore(MOST_AT_A_TIME), threading.Semaphore(MOST_AT_A_TIME)
_served: Deque[Any] = collections.deque()  # connections to services, oldest first
_serving = threading.Lock()  # guards it
# rospy's handlers are made for one connection at a time; before any lock of theirs. One for each topic or service: what
# a node does when somebody listens, as to ask the master, may take long. Strangers name what they like
_handling = NamedLocks()


def hear_out_each_by_itself() -> None:
    """Have this process hear out who connects in a thread each; before rospy.init_node."""
    TCPServer.run = take_all
    TCPROSServer._tcp_server_callback = take_up
    SilenceableXMLRPCRequestHandler.timeout = LONGEST_SILENCE
    ThreadingXMLRPCServer.request_queue_size = WAITING_AT_MOST
    ThreadingXMLRPCServer.process_request = answer
    ThreadingXMLRPCServer.process_request_thread = _answer
    ServiceImpl.handle = serve


def take_all(server: Any) -> None:
    """Take connections as TCPServer.run does, which ends for good where there is no file for one."""
    server.server_sock.listen(WAITING_AT_MOST)
    while not server.is_shutdown:
        try:
            _take_as_rospy(server)
        except OSError as error:
            if error.errno not in OUT_OF_FILES:
                raise
            time.sleep(PAUSE)


def take_up(server: Any, connection: socket.socket, address: Tuple[str, int]) -> None:
    """Take a connection up as TCPROSServer does, without waiting for it."""
    if not _unheard.acquire(blocking=False):
        connection.close()
        return
    try:
        threading.Thread(
            target=_hear_out, args=(server, connection, address), name="TCPROS handshake", daemon=True).start()
    except RuntimeError:  # there is no thread left: whoever comes later may find one
        _unheard.release()
        connection.close()


def answer(server: Any, connection: socket.socket, address: Tuple[str, int]) -> None:
    """Answer a connection in XML-RPC as ThreadingXMLRPCServer does."""
    if not _calling.acquire(blocking=False):
        server.shutdown_request(connection)
        return
    try:
        ThreadingMixIn.process_request(server, connection, address)
    except RuntimeError:
        _calling.release()
        raise


def _answer(server: Any, connection: socket.socket, address: Tuple[str, int]) -> None:
    try:
        ThreadingMixIn.process_request_thread(server, connection, address)
    finally:
        _calling.release()


def serve(service: Any, connection: Any, header: Mapping[str, str]) -> None:
    """Serve a connection to a service as ServiceImpl.handle does; for too many, the oldest of them ends."""
    with _serving:
        _served.append(connection)
        oldest = _served.popleft() if len(_served) > MOST_AT_A_TIME else None
    if oldest is not None:
        _hang_up(oldest.socket)
    try:
        if _asks(connection.socket):
            _serve_as_rospy(service, connection, header)
        else:
            connection.close()
    finally:
        with _serving:
            if connection in _served:
                _served.remove(connection)


def _asks(connection: socket.socket) -> bool:
    """Wait for what a connection asks; return whether it does: who leaves before is no error, as it is to rospy."""
    try:
        return bool(connection.recv(1, socket.MSG_PEEK))
    except OSError:
        return False


def _hang_up(connection: Optional[socket.socket]) -> None:
    """End a connection for the thread that reads from it."""
    try:
        if connection is not None:
            connection.shutdown(socket.SHUT_RDWR)
    except OSError:
        pass  # it has ended by itself


def _hear_out(server: Any, connection: socket.socket, address: Tuple[str, int]) -> None:
    try:
        header = first_words(connection)
        if header is None:
            connection.close()
            return
        with _handling.of(header.get("topic") or header.get("service", "")):
            trouble = _hand_over(server, connection, address, header)
        if trouble:
            write_ros_handshake_header(connection, {"error": trouble})
    except Exception as error:  # it came from outside: nothing of it may end more than this connection
        trouble = str(error)
    finally:
        _unheard.release()
    if trouble:
        connection.close()
        if not rospy.core.is_shutdown_requested():
            rospy.logwarn_throttle(PATIENCE, f"a connection from {address[0]} was refused: {trouble[:200]}")


def first_words(connection: socket.socket) -> Optional[Dict[str, str]]:
    """Return what who connected says of itself, None where it left without a word, as who ends at that moment does.

    The connection waits without limit again afterwards.

    Raises:
        ROSHandshakeException: It says nothing in time, or nothing of use.
    """
    end, read = time.monotonic() + PATIENCE, b""
    while len(read) < _LENGTH.size or len(read) < _LENGTH.size + _LENGTH.unpack_from(read)[0]:
        if len(read) >= _LENGTH.size and _LENGTH.unpack_from(read)[0] > LONGEST:
            raise ROSHandshakeException(f"its first words are {_LENGTH.unpack_from(read)[0]} bytes; at most {LONGEST}")
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


def listeners() -> int:
    """Return how many connections listen to this node's topics."""
    return sum(len(topic.connections) for topic in list(get_topic_manager().pubs.values()))


def _hand_over(server: Any, connection: socket.socket, address: Tuple[str, int], header: Dict[str, str]) -> str:
    """Hand a connection to rospy; return why it is refused, empty where it is not."""
    if "topic" in header:
        if listeners() >= MOST_LISTENERS:
            return f"{MOST_LISTENERS} connections listen to this node's topics already"
        handle = server.topic_connection_handler
    elif "service" in header:
        handle = server.service_connection_handler
    else:
        return "no topic or service name detected"
    trouble = handle(connection, address, header)
    return "node shutting down" if trouble and rospy.core.is_shutdown_requested() else trouble or ""
