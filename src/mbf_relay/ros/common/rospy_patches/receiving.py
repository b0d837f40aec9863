"""Receiving messages with less CPU time than rospy.

When a message wakes a node, its code is in no CPU cache: what takes 10 microseconds in a loop then takes 150, nearly
all for fetching instructions. `/clock` alone, at 60 Hz in each node, took a quarter of a small computer's time. So the
usual case has a short code path, and everything else is left to rospy.
"""

from __future__ import annotations

import errno
import socket
import struct
import time
from typing import Any, Sequence, Union

import rospy.impl.simtime
from genpy import DeserializationError
from rosgraph_msgs.msg import Clock
from rospy import rostime
from rospy.exceptions import TransportTerminated
from rospy.impl.tcpros_base import TCPROSTransport, TCPROSTransportProtocol

CLOCK_PAUSE = 0.1
"""Wall seconds between two readings of /clock in a node that only needs it for stamps."""
LARGEST = 1 << 26
"""Largest message length (bytes) for which memory is allocated before the message has arrived."""
PIECE = 4096
"""Bytes that are read first of a message whose class has `make_room`; the rest is read into its own buffer."""
_LENGTH = struct.Struct("<I")
_receive_as_rospy = TCPROSTransport.receive_once


def apply_patches() -> None:
    """Apply this module's patches to rospy; before rospy.init_node."""
    TCPROSTransport.receive_once = receive_once
    rospy.impl.simtime._set_rostime_clock_wrapper = _clock.take


def receive_once(transport: Any) -> Sequence[Any]:
    """Wait for messages and return them, as TCPROSTransport.receive_once does, which it replaces.

    In the usual case one read returns one whole message, which is deserialized without a copy. Of a longer message, as
    a point cloud, the rest is read into one buffer of its length, while rospy copies ten megabytes five times. A
    message class may have `make_room(length)`, which returns that buffer; it then gets the buffer itself and no copy.
    """
    buffer, protocol = transport.read_buff, transport.protocol
    message_class = protocol.recv_data_class
    make_room = getattr(message_class, "make_room", None)
    is_plain = type(protocol).read_messages is TCPROSTransportProtocol.read_messages  # a service's answer is not
    if buffer.tell() or message_class is None or transport.socket is None or not is_plain:
        return _receive_as_rospy(transport)  # type: ignore[no-any-return]
    try:
        transport.socket.setblocking(True)
        data = transport.socket.recv(PIECE if make_room else protocol.buff_size)
    except OSError as error:
        if error.errno == errno.EBADF:  # unsubscribed in another thread: rospy would log an error and reconnect
            raise TransportTerminated("nobody listens any more") from error
        return _receive_as_rospy(transport)  # type: ignore[no-any-return]  # which gets the same error and handles it
    here = len(data) - _LENGTH.size
    length = _LENGTH.unpack_from(data)[0] if here >= 0 else 0
    if not 0 <= here <= length <= max(here, LARGEST):  # less than a length, more than one message, or a huge one
        buffer.write(data)
        return _receive_as_rospy(transport)  # type: ignore[no-any-return]
    text: Union[bytes, memoryview] = data[_LENGTH.size:]
    if here < length:
        room = memoryview((make_room or bytearray)(length))
        _read_on(transport, text, room)
        text = room if make_room else bytes(room)
    try:
        message = message_class().deserialize(text)
    except DeserializationError:
        buffer.write(_LENGTH.pack(length))
        buffer.write(text)
        return _receive_as_rospy(transport)  # type: ignore[no-any-return]
    message._connection_header = transport.header
    transport.stat_bytes += _LENGTH.size + length
    transport.stat_num_msg += 1
    if transport.is_latched:
        transport.latch = message
    return (message,)


def _read_on(transport: Any, begun: bytes, room: memoryview) -> None:
    """Fill `room` with a message whose beginning was read already.

    Raises:
        TransportTerminated: The connection was closed before its end.
    """
    room[:len(begun)] = begun
    rest = room[len(begun):]
    while rest:
        try:
            count = transport.socket.recv_into(rest, 0, socket.MSG_WAITALL)
        except (OSError, AttributeError) as error:  # AttributeError: socket is None, as it was closed in this process
            raise TransportTerminated(f"connection lost in the middle of a message: {error}") from error
        if count == 0:
            raise TransportTerminated("connection lost in the middle of a message")
        rest = rest[count:]


class ClockReader:
    """The callback of rospy's subscriber of /clock.

    Attributes:
        pause: Wall time (s) to sleep after each message; of those that arrive meanwhile only the newest is read.
    """

    pause = 0.0

    def take(self, message: Clock) -> None:
        """Set ROS time, in the thread that receives /clock."""
        set_time(message)
        if self.pause > 0.0:
            time.sleep(self.pause)


_clock = ClockReader()


def look_at_clock_seldom() -> None:
    """Read /clock only every CLOCK_PAUSE in this process.

    For a node that needs ROS time for stamps only; to wake for each message would be most of its CPU time.
    """
    _clock.pause = CLOCK_PAUSE


def set_time(message: Clock) -> None:
    """Set ROS time and wake threads that wait for it, as rospy does, but without its deprecated notifyAll."""
    rostime._rostime_current = rostime.Time(message.clock.secs, message.clock.nsecs)
    with rostime._rostime_cond:
        rostime._rostime_cond.notify_all()
