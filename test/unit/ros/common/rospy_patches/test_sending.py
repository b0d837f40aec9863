"""Small messages that go out without a thread: whole, in order, and never held up by a listener that hangs."""

import socket
import struct
import threading
from types import SimpleNamespace

import genpy
import pytest
import rospy.topics
from geometry_msgs.msg import Twist, Vector3
from ros_testing import wait_until
from rospy.exceptions import TransportTerminated
from rospy.impl.tcpros_base import TCPROSTransport, TCPROSTransportProtocol

from mbf_relay.ros.common.rospy_patches import sending

SIZES = (sending.SMALL, 7, sending.SMALL + 1, 30, 200_000, 12)


@pytest.fixture
def listener():
    """Return a connection, and the socket its listener reads."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        near = socket.create_connection(server.getsockname())
        far = server.accept()[0]
    far.settimeout(20.0)
    transport = TCPROSTransport(TCPROSTransportProtocol("/somewhere", None), "somewhere")
    transport.set_socket(near, "somebody")
    connection = sending.DirectConnection(transport, 3)
    yield connection, far
    transport.close()
    far.close()
    connection._thread.join(20.0)
    assert not connection._thread.is_alive()


def read(far, count):
    data = b""
    while len(data) < count:
        data += far.recv(count - len(data))
    return data


def test_messages_of_all_sizes_arrive_whole_and_in_order(listener):
    connection, far = listener
    for turn in range(60):
        message = bytes([turn]) * SIZES[turn % len(SIZES)]
        connection.write_data(message)
        if turn % 3 == 2:  # as many as the queue holds
            expected = b"".join(bytes([each]) * SIZES[each % len(SIZES)] for each in range(turn - 2, turn + 1))
            assert read(far, len(expected)) == expected


def test_a_small_message_goes_out_in_the_thread_that_publishes(listener, monkeypatch):
    connection, far = listener
    threads, send = [], connection._connection.write_data
    monkeypatch.setattr(
        connection._connection, "write_data", lambda data: (threads.append(threading.current_thread()), send(data)))
    connection.write_data(b"clock")
    assert read(far, 5) == b"clock" and threads == [threading.current_thread()]


def test_a_listener_that_hangs_holds_up_nobody_and_hears_the_newest_when_it_goes_on(listener):
    connection, far = listener
    sent = 0
    while connection._has_room() or sent < 20_000:  # far more than two buffers hold
        connection.write_data(sent.to_bytes(4, "big") * 250)
        sent += 1
    assert len(connection._queue) == 3
    heard = []
    while not heard or heard[-1] != sent - 1:
        block = read(far, 1000)
        assert block == block[:4] * 250, "no message is cut"
        heard.append(int.from_bytes(block[:4], "big"))
    assert heard == sorted(heard) and len(heard) < sent


def test_who_publishes_hears_that_a_listener_is_gone(listener):
    connection, far = listener
    far.close()

    def is_told():
        try:
            connection.write_data(b"is anybody there?")
        except TransportTerminated:
            return True
        except OSError:  # reset before the pipe breaks
            return False
        return False

    wait_until(is_told, "the end of the connection", 20.0)
    assert connection._connection.done


@pytest.fixture
def sends_with_less(monkeypatch):
    """Have rospy publish as in a node."""
    monkeypatch.setattr(rospy.topics, "QueuedConnection", None)
    monkeypatch.setattr(rospy.topics._PublisherImpl, "publish", rospy.topics._PublisherImpl.publish)
    sending.apply_patches()


def test_all_that_a_node_publishes_goes_this_way(sends_with_less):
    assert rospy.topics.QueuedConnection is sending.DirectConnection


def test_a_velocity_that_goes_out_while_other_wheels_are_told_to_stand_reaches_them_as_it_is(sends_with_less):
    class Standing(Twist):
        """A zero that is being written when somebody else publishes."""

        def serialize(self, buff):
            buff.write(struct.pack("<3d", 0.0, 0.0, 0.0))
            other = threading.Thread(target=publish_unless_held)
            other.start()
            other.join(20.0)
            buff.write(struct.pack("<3d", 0.0, 0.0, 0.0))

    def publish_unless_held():
        if topic.publock.acquire(blocking=False):  # as Publisher.publish does, which waits
            topic.publish(Twist(linear=Vector3(x=0.5)))
            topic.publock.release()

    sent = []
    topic = rospy.topics._PublisherImpl("/cmd_vel", Twist)
    topic.connections = [SimpleNamespace(write_data=sent.append)]
    topic.publish(Standing(), connection_override=SimpleNamespace(write_data=sent.append))
    topic.publish(Twist(linear=Vector3(x=0.5)))
    assert [len(data) for data in sent] == [52, 52]
    assert [Twist().deserialize(data[4:]).linear.x for data in sent] == [0.0, 0.5]


def test_who_publishes_on_a_topic_that_was_closed_is_told_so(sends_with_less):
    topic = rospy.topics._PublisherImpl("/cmd_vel", Twist)
    topic.close()
    with pytest.raises(rospy.ROSException, match="closed"):
        topic.publish(Twist())


@pytest.mark.parametrize("field", ["0.5 m/s", None])
def test_wheels_understand_what_comes_after_a_velocity_that_is_no_number(sends_with_less, field):
    """What was written of it stayed before all that came later, and the wheels heard nothing any more."""
    sent, velocity = [], Twist()
    velocity.angular.z = field
    topic = rospy.topics._PublisherImpl("/cmd_vel", Twist)
    topic.enable_latch()
    topic.connections = [SimpleNamespace(write_data=sent.append)]
    topic.publish(Twist(linear=Vector3(x=0.25)))
    with pytest.raises((genpy.SerializationError, rospy.ROSException)):
        topic.publish(velocity)
    assert topic.latch.linear.x == 0.25, "what a newcomer is told"
    topic.publish(Twist(linear=Vector3(x=0.5)))
    assert [Twist().deserialize(data[4:]).linear.x for data in sent] == [0.25, 0.5]
