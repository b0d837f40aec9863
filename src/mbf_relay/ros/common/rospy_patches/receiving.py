"""What rospy does for each message that comes, done with less.

A message finds a node asleep and its code in no cache: what takes 10 microseconds in a loop then takes 150, nearly all
of them spent on fetching what is executed. `/clock` alone, sixty times a second in each node, was a quarter of a small
computer's work. So the usual case is a short way of its own, and whatever is unusual is left to rospy.
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
"""Wall seconds between two looks at /clock of a node that only dates what it says."""
LARGEST = 1 << 26
"""Bytes of a message beyond which room is not made on its word, before it is there."""
PIECE = 4096
"""Bytes that are read first of a message that then tells where the rest shall lie."""
_LENGTH = struct.Struct("<I")
_receive_as_rospy = TCPROSTransport.receive_once


def receive_with_less() -> None:
    """Have this process receive messages and take over simulated time with less work; before rospy.init_node."""
    TCPROSTransport.receive_once = receive_once
    rospy.impl.simtime._set_rostime_clock_wrapper = _clock.take


def receive_once(transport: Any) -> Sequence[Any]:
    """Return the messages that come next, as TCPROSTransport.receive_once does; it waits for one.

    Where one read brings one message and nothing else, as nearly always, that is read from where it lies. Where it
    brings the beginning of one, as of a cloud of points, the rest is read to where it belongs: rospy copies ten
    megabytes five times. Where a class of messages tells where that is, by `make_room(length)`, it is handed no copy.
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
        if error.errno == errno.EBADF:  # who stopped to listen has closed it: rospy would tell of it, and reconnect
            raise TransportTerminated("nobody listens any more") from error
        return _receive_as_rospy(transport)  # type: ignore[no-any-return]  # which meets it too, and knows what to do
    here = len(data) - _LENGTH.size
    length = _LENGTH.unpack_from(data)[0] if here >= 0 else 0
    if not 0 <= here <= length <= max(here, LARGEST):  # a piece of one, or several
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
    """Fill `room` with a message that has begun to come.

    Raises:
        TransportTerminated: The connection ended before.
    """
    room[:len(begun)] = begun
    rest = room[len(begun):]
    while rest:
        try:
            count = transport.socket.recv_into(rest, 0, socket.MSG_WAITALL)
        except (OSError, AttributeError) as error:  # the latter where it was closed here
            raise TransportTerminated(f"connection lost in the middle of a message: {error}") from error
        if count == 0:
            raise TransportTerminated("connection lost in the middle of a message")
        rest = rest[count:]


class ClockReader:
    """Takes over the times of /clock.

    Attributes:
        pause: Wall time (s) from one to the next; what comes meanwhile waits, and of that the newest counts.
    """

    pause = 0.0

    def take(self, message: Clock) -> None:
        """Take a time, in rospy's thread of /clock, which then reads on."""
        set_time(message)
        if self.pause > 0.0:
            time.sleep(self.pause)


_clock = ClockReader()


def look_at_clock_seldom() -> None:
    """Have this process look at /clock every CLOCK_PAUSE.

    For a node that does nothing at a time of its own and only dates what it says: to wake for each message is nearly
    all it would ever do.
    """
    _clock.pause = CLOCK_PAUSE


def set_time(message: Clock) -> None:
    """Show a simulated time, and wake who waits for one: rospy's own way calls what Python warns of each time."""
    rostime._rostime_current = rostime.Time(message.clock.secs, message.clock.nsecs)
    with rostime._rostime_cond:
        rostime._rostime_cond.notify_all()
