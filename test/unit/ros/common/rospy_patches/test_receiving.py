"""What comes over a connection: every message, whole and in order, however it is cut up on the way."""

import random
import socket
import struct
import threading

import pytest
import rospy
from actionlib_msgs.msg import GoalID
from rosgraph_msgs.msg import Clock
from rospy.exceptions import TransportException, TransportTerminated
from rospy.impl.tcpros_base import TCPROSTransport
from rospy.impl.tcpros_pubsub import TCPROSSub
from rospy.impl.tcpros_service import TCPROSServiceClient
from std_srvs.srv import Trigger

from mbf_relay.ros.common.rospy_patches import receiving


class Connection:
    """A subscriber's end, and the other one."""

    def __init__(self, monkeypatch, queue_size=None):
        monkeypatch.setattr("rospy.impl.tcpros_base.is_shutdown", lambda: False)
        self.far, near = socket.socketpair()
        self.transport = TCPROSTransport(TCPROSSub("/goal", GoalID, queue_size), "/goal", {"callerid": "/far"})
        self.transport.socket = near

    def receive(self):
        return [message.id for message in receiving.receive_once(self.transport)]

    def close(self):
        self.far.close()
        self.transport.close()


@pytest.fixture
def connection(monkeypatch):
    connection = Connection(monkeypatch)
    yield connection
    connection.close()


def framed(*names):
    parts = []
    for name in names:
        body = struct.pack("<II", 1, 2) + struct.pack("<I", len(name)) + name.encode()
        parts.append(struct.pack("<I", len(body)) + body)
    return b"".join(parts)


def test_a_message_that_comes_alone_is_there_with_who_sent_it(connection):
    connection.far.sendall(framed("one"))
    message, = receiving.receive_once(connection.transport)
    assert message.id == "one" and message._connection_header == {"callerid": "/far"}
    assert (connection.transport.stat_num_msg, connection.transport.stat_bytes) == (1, len(framed("one")))


def test_several_in_one_piece_are_all_there(connection):
    connection.far.sendall(framed("one", "", "three"))
    assert connection.receive() == ["one", "", "three"]
    connection.far.sendall(framed("four"))
    assert connection.receive() == ["four"]


def test_where_only_the_newest_is_wanted_it_is_the_newest(monkeypatch):
    connection = Connection(monkeypatch, queue_size=1)
    connection.far.sendall(framed("old", "new"))
    assert connection.receive() == ["new"]
    connection.close()


@pytest.mark.parametrize("seed", range(20))
def test_however_a_stream_is_cut_up_nothing_is_lost_or_changed(monkeypatch, seed):
    chance = random.Random(seed)
    names = ["x" * chance.choice((0, 1, 40, 3000)) + str(number) for number in range(60)]
    stream, connection = framed(*names), Connection(monkeypatch)
    connection.transport.protocol.buff_size = chance.choice((7, 64, 4096, 65536))

    def send():
        begin = 0
        while begin < len(stream):
            end = begin + chance.choice((1, 3, 16, 20, 500, 9000))
            connection.far.sendall(stream[begin:end])
            begin = end

    sender = threading.Thread(target=send)
    sender.start()
    received = []
    while len(received) < len(names):
        received += connection.receive()
    sender.join()
    assert received == names
    connection.close()


@pytest.mark.parametrize("seed", range(4))
def test_a_cloud_of_megabytes_comes_whole_though_it_is_cut_up(monkeypatch, seed):
    chance, connection, received = random.Random(seed), Connection(monkeypatch), []
    names = ["a" * chance.randint(1, 9_000_000), "b", "c" * 300_000, "d"]
    connection.transport.protocol.buff_size = chance.choice((65536, 1 << 24))
    sender = threading.Thread(target=lambda: connection.far.sendall(framed(*names)))
    sender.start()
    while len(received) < len(names):
        received += connection.receive()
    sender.join()
    assert received == names
    connection.close()


@pytest.mark.parametrize("size", [0, 1, 300, 200_000, 3_000_000])
def test_a_service_s_answer_comes_whole_though_a_byte_stands_before_it(monkeypatch, size):
    """amcl asked for its map for ever: the byte that says that all is well was taken for a part of the length."""
    connection, received = Connection(monkeypatch), []
    connection.transport.protocol = TCPROSServiceClient("/trigger", Trigger)
    body = struct.pack("<BI", 1, size) + b"x" * size
    reader = threading.Thread(target=lambda: received.extend(receiving.receive_once(connection.transport)))
    reader.start()
    connection.far.sendall(b"\x01" + struct.pack("<I", len(body)) + body)
    reader.join(20.0)
    connection.far.close()
    assert [(answer.success, answer.message) for answer in received] == [(True, "x" * size)]
    connection.close()


def test_a_publisher_that_is_gone_in_the_middle_of_a_cloud_ends_the_connection(connection):
    connection.far.sendall(framed("x" * 10_000)[:5000])
    connection.far.close()
    with pytest.raises(TransportTerminated, match="middle"):
        connection.receive()


def test_a_message_that_says_it_were_huge_takes_no_memory_before_it_is_there(connection):
    connection.far.sendall(struct.pack("<I", 0xFFFFFFF0) + b"abc")
    connection.far.close()
    with pytest.raises(TransportTerminated):
        connection.receive()


def test_a_message_that_came_in_pieces_and_cannot_be_read_is_refused_as_rospy_refuses_it(connection):
    connection.transport.protocol.buff_size = 5
    connection.far.sendall(struct.pack("<I", 3) + b"abc")
    with pytest.raises(TransportException, match="DeserializationError"):
        connection.receive()


def test_a_publisher_that_is_gone_ends_the_connection(connection):
    connection.far.close()
    with pytest.raises(TransportTerminated):
        connection.receive()


def test_a_node_that_stops_listening_between_two_messages_leaves_no_traceback(monkeypatch, connection, caplog):
    """As velocity_guard where it knows its lidars: rospy took the closed socket for a fault and opened another."""
    reconnects, transport = [], connection.transport
    monkeypatch.setattr(transport, "receive_once", lambda: receiving.receive_once(transport))
    monkeypatch.setattr(transport, "_reconnect", lambda: (reconnects.append(transport), transport.close()))
    transport.socket.close()
    transport.receive_loop(lambda messages, _transport: None)
    assert transport.done and not reconnects and "Traceback" not in caplog.text


def test_a_message_that_cannot_be_read_is_refused_as_rospy_refuses_it(connection):
    connection.far.sendall(struct.pack("<I", 3) + b"abc")
    with pytest.raises(TransportException, match="DeserializationError"):
        connection.receive()


def test_who_subscribes_later_in_the_same_process_gets_the_last_latched_one(connection):
    connection.transport.is_latched = True
    connection.far.sendall(framed("map"))
    connection.receive()
    assert connection.transport.latch.id == "map"


def test_simulated_time_is_shown_and_wakes_who_waits_for_it(monkeypatch):
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    monkeypatch.setattr(rospy.rostime, "_rostime_current", rospy.Time(1))
    condition, seen = rospy.rostime._rostime_cond, []

    def wait():
        with condition:
            ready.set()
            condition.wait(20.0)
            seen.append(rospy.get_rostime())

    ready = threading.Event()
    waiting = threading.Thread(target=wait)
    waiting.start()
    assert ready.wait(20.0)
    receiving.set_time(Clock(rospy.Time(7, 5)))
    waiting.join(20.0)
    assert seen == [rospy.Time(7, 5)]


def test_all_that_a_node_receives_comes_this_way(monkeypatch):
    monkeypatch.setattr(TCPROSTransport, "receive_once", None)
    monkeypatch.setattr("rospy.impl.simtime._set_rostime_clock_wrapper", None)
    receiving.apply_patches()
    assert TCPROSTransport.receive_once is receiving.receive_once
    assert rospy.impl.simtime._set_rostime_clock_wrapper == receiving._clock.take


@pytest.mark.parametrize("is_idle, rests", [(False, []), (True, [receiving.CLOCK_PAUSE] * 2)])
def test_who_only_dates_what_it_says_does_not_wake_for_each_time(monkeypatch, is_idle, rests):
    taken, rested = [], []
    monkeypatch.setattr(receiving, "set_time", lambda message: taken.append(message.clock.secs))
    monkeypatch.setattr(receiving.time, "sleep", rested.append)
    monkeypatch.setattr(receiving, "_clock", receiving.ClockReader())
    if is_idle:
        receiving.look_at_clock_seldom()
    for seconds in (7, 8):
        receiving._clock.take(Clock(rospy.Time(seconds)))
    assert (taken, rested) == ([7, 8], rests)
