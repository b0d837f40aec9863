"""Scans are given out once, when they are ready, and the newest of each lidar alone."""

import math
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import Transform, TransformStamped
from hypothesis import given
from hypothesis import strategies as st
from ros_testing import wait_until
from sensor_msgs.msg import LaserScan as LaserScanMessage

from mbf_relay.outcomes import TransformError
from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.lidar_geometry import mounting_of, scan_in_base, seen_from_above
from mbf_relay.ros.common.message_queue import MessageQueue
from mbf_relay.ros.common.throttled_warnings import ThrottledWarnings
from mbf_relay.scan import LaserScan


def message(stamp, frame="front"):
    made = LaserScanMessage(ranges=[1.0, 2.0], angle_increment=0.1, range_max=5.0)
    made.header.stamp, made.header.frame_id = rospy.Time.from_sec(stamp), frame
    return made


def stamps(messages):
    return [(m.header.frame_id, m.header.stamp.to_sec()) for m in messages]


def filled(*scans, length=100):
    queue = MessageQueue(length)
    for stamp, frame in scans:
        queue.put(message(stamp, frame))
    return queue


def take(queue, is_ready=lambda _: True):
    return stamps(queue.take(is_ready, timeout=0.0))


def test_the_newest_ready_scan_of_each_lidar_comes_in_order_of_time():
    queue = filled((1.0, "front"), (1.0625, "rear"), (1.25, "front"), (1.125, "rear"))
    assert take(queue) == [("rear", 1.125), ("front", 1.25)]
    assert take(queue) == []
    assert queue.oldest() is None


def test_a_scan_waits_until_its_transform_is_there():
    queue = filled((1.0, "front"), (1.125, "front"), (1.25, "front"))
    assert take(queue, lambda m: m.header.stamp.to_sec() < 1.2) == [("front", 1.125)]
    assert stamps([queue.oldest()]) == [("front", 1.25)]
    assert take(queue, lambda _: False) == []
    assert take(queue) == [("front", 1.25)]


def test_one_lidar_does_not_hold_up_another():
    queue = filled((1.0, "nowhere"), (1.125, "front"))
    assert take(queue, lambda m: m.header.frame_id == "front") == [("front", 1.125)]
    assert stamps([queue.oldest()]) == [("nowhere", 1.0)]


def test_the_oldest_goes_where_there_is_no_room():
    queue = filled(*((float(index), "front") for index in range(5)), length=3)
    assert stamps([queue.oldest()]) == [("front", 2.0)]


def test_time_set_back_ends_what_waits():
    queue = filled((100.0, "front"), (2.0, "front"))
    assert take(queue, lambda m: m.header.stamp.to_sec() > 50.0) == []
    assert take(queue) == [("front", 2.0)]


def test_a_scan_that_comes_while_others_are_looked_at_is_kept():
    queue = filled((1.0, "front"))

    def is_ready(_):
        queue.put(message(1.125))
        return True

    assert take(queue, is_ready) == [("front", 1.0)]
    assert take(queue) == [("front", 1.125)]


@given(st.lists(st.tuples(st.integers(0, 20), st.sampled_from(["front", "rear"]), st.booleans()), max_size=30))
def test_every_scan_is_given_once_at_most_and_never_an_older_one_after_a_newer(steps):
    """Whatever comes when: of each lidar, what is given has ever newer stamps."""
    queue, given_out = MessageQueue(), {"front": [-1.0], "rear": [-1.0]}
    clock = 0.0
    for ahead, frame, look in steps:
        clock += ahead * 0.01
        queue.put(message(clock, frame))
        if look:
            for name, stamp in take(queue, lambda m: m.header.stamp.to_sec() <= clock - 0.05):
                given_out[name].append(stamp)
    for given_stamps in given_out.values():
        assert given_stamps == sorted(given_stamps)


def rotation(roll, yaw):
    """Return a transform turned by roll, then by yaw."""
    made = Transform()
    made.translation.x, made.translation.y = 0.1, -0.2
    half_roll, half_yaw = roll / 2.0, yaw / 2.0
    made.rotation.x = math.sin(half_roll) * math.cos(half_yaw)
    made.rotation.y = math.sin(half_roll) * math.sin(half_yaw)
    made.rotation.z = math.cos(half_roll) * math.sin(half_yaw)
    made.rotation.w = math.cos(half_roll) * math.cos(half_yaw)
    return made


@pytest.mark.parametrize("yaw", [0.0, 0.7, math.pi, -2.5])
@pytest.mark.parametrize("roll", [0.0, math.pi])
def test_beams_point_where_the_mounting_turns_them(roll, yaw):
    """A beam at angle b, rolled by half a turn, points to -b; backwards, to b + pi: amcl's angles in the base."""
    pose, upside_down = mounting_of(rotation(roll, yaw))
    scan = seen_from_above(LaserScan(np.ones(3), 0.3, 0.2, 0.1, 5.0, 0.0), upside_down)
    sign = -1.0 if roll else 1.0
    got = scan.angles + pose.theta
    wanted = yaw + sign * np.array([0.3, 0.5, 0.7])
    assert np.exp(1j * got) == pytest.approx(np.exp(1j * wanted), abs=1e-12)
    assert (pose.x, pose.y) == (0.1, -0.2)


def test_a_lidar_that_is_moved_on_its_robot_is_seen_from_where_it_sits_now():
    """By amcl and by the guard it sat for good where it had been first; costmaps had it where it was."""

    class Lookups:
        def __init__(self):
            self.yaw = 0.5

        def lookup_message(self, base, frame, **_):
            assert (base, frame) == ("base_link", "front")
            return TransformStamped(transform=rotation(math.pi, self.yaw))

    lookups = Lookups()
    for lookups.yaw in (0.5, -0.3):
        scan, pose, is_fixed = scan_in_base(message(1.0), "base_link", lookups)
        assert scan.angle_increment == -message(1.0).angle_increment
        assert pose.theta == pytest.approx(lookups.yaw) and is_fixed


@pytest.mark.parametrize("told_until, looked_at", [(1.2, 1.0), (0.9, 0.9)])
def test_a_lidar_that_pans_is_seen_from_where_it_looked_when_its_scan_was_taken(told_until, looked_at):
    """By amcl and by the guard walls stood as far aside as it had turned since, a scan's time and more."""

    class Pan:
        def lookup_message(self, _base, _frame, stamp=None, **_):
            if stamp is not None and stamp > told_until:
                raise TransformError("extrapolation into the future")
            time = told_until if stamp is None else stamp
            placed = TransformStamped(transform=rotation(0.0, time))
            placed.header.stamp = rospy.Time.from_sec(time)
            return placed

    mounted = scan_in_base(message(1.0), "base_link", Pan())
    assert mounted.laser_in_base.theta == pytest.approx(looked_at) and not mounted.is_fixed


@pytest.mark.parametrize("roll", [math.pi / 2.0, -math.pi / 2.0, 1.2, 2.0])
def test_a_lidar_on_edge_which_sees_the_ceiling_is_not_believed_to_look_round_the_robot(roll):
    lookups = SimpleNamespace(lookup_message=lambda *_, **__: TransformStamped(transform=rotation(roll, 0.3)))
    with pytest.raises(InvalidMessage, match=r"frame front is tilted by \d+ degrees against base_link"):
        scan_in_base(message(1.0), "base_link", lookups)
    lookups.lookup_message = lambda *_, **__: TransformStamped(transform=rotation(roll / 4.0, 0.3))
    assert scan_in_base(message(1.0), "base_link", lookups).laser_in_base.theta == pytest.approx(0.3)


def test_a_scan_is_given_as_soon_as_its_transform_has_come():
    queue, transforms = filled((1.0, "front")), []
    given = []

    def work():
        while not given:
            given.extend(queue.take(lambda _: bool(transforms), 60.0))

    worker = threading.Thread(target=work, daemon=True)
    worker.start()  # asks at once, in vain, and then waits for news
    wait_until(lambda: not queue._has_news, "the first look")
    transforms.append("odom")
    queue.look_again()
    worker.join(30.0)
    assert stamps(given) == [("front", 1.0)]


def test_a_scan_that_comes_before_the_clock_is_worth_no_warning_but_wrong_stamps_that_go_on_are():
    told, wall = [], [0.0]
    queue = MessageQueue(warnings=ThrottledWarnings(lambda: wall[0], lambda _, text: told.append(text)))
    queue.offer(message(2.6), 0.0)
    queue.offer(message(3.0), 3.0)
    assert not told and stamps(queue.take(lambda _: True, 0.0)) == [("front", 3.0)]
    for wall[0] in (1.0, 2.0, 3.0):
        queue.offer(message(900.0), 3.0)
    assert "a message of sensor_msgs/LaserScan refused: its stamp 900.00 s is 897.00 s ahead of the clock" in told[0]
    assert queue.oldest() is None
