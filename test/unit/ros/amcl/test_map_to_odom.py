"""map -> odom is dated ahead, no two have one stamp, and it goes on where scans do not."""

import threading
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
import rospy
from sensor_msgs.msg import LaserScan as LaserScanMessage

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.ros.amcl import node as amcl
from mbf_relay.ros.amcl.map_to_odom import PAUSE, MapToOdom
from mbf_relay.ros.amcl.saved_pose import SavedPose
from mbf_relay.ros.common.lidar_geometry import MountedScan
from mbf_relay.scan import LaserScan

POSE = Pose2D(1.0, 2.0, 0.3)


class Outbox:
    def __init__(self):
        self.sent = []

    def send(self, parent, child, pose, stamp):
        self.sent.append((parent, child, pose, stamp.to_sec()))

    @property
    def stamps(self):
        return [stamp for _, _, _, stamp in self.sent]


@pytest.fixture(name="sender")
def make_sender(monkeypatch):
    """Return a sender and what it sends, at a ROS time of the test's making, without its thread."""
    clock = [rospy.Time(0)]
    monkeypatch.setattr(rospy, "get_rostime", lambda: clock[0])
    outbox = Outbox()
    sender = MapToOdom(outbox)
    sender.close()
    sender.configure("map", "odom", 0.5, True)

    def update(stamp, now):
        clock[0] = rospy.Time.from_sec(now)
        sender.update(POSE, rospy.Time.from_sec(stamp))
        clock[0] = rospy.Time(0)

    return sender, outbox, update


def test_a_scan_sends_it_dated_ahead(sender):
    _, outbox, update = sender
    update(10.0, 10.25)
    assert outbox.sent == [("map", "odom", POSE, 10.5)]


def test_a_stamp_is_not_sent_again_though_others_came_between(sender):
    _, outbox, update = sender
    for stamp in (69.0, 68.8, 69.0, 69.2, 69.0):
        update(stamp, 69.5)
    assert len(set(outbox.stamps)) == 5
    assert max(outbox.stamps) - 69.7 < 1e-5


def test_it_goes_on_where_scans_pause_and_not_before(sender):
    sender, outbox, update = sender
    sender.repeat_if_due(rospy.Time.from_sec(9.0))
    assert outbox.sent == []  # nothing is known yet
    update(10.0, 10.25)
    sender.repeat_if_due(rospy.Time.from_sec(10.25 + PAUSE))
    assert outbox.stamps == [10.5]
    sender.repeat_if_due(rospy.Time.from_sec(10.75))
    assert outbox.stamps == [10.5, 11.25]
    sender.repeat_if_due(rospy.Time.from_sec(10.875))
    assert outbox.stamps == [10.5, 11.25]  # far enough ahead still


def test_who_looks_when_it_says_that_it_is_due_never_lets_it_fall_behind_and_looks_seldom(sender):
    sender, outbox, update = sender
    update(10.0, 10.25)
    now, looks = 10.25, 0
    while now < 13.0:
        due = sender.repeat_if_due(rospy.Time.from_sec(now))
        looks, now = looks + 1, now + max(due, 0.02)
        assert now < max(outbox.stamps) + 0.1, outbox.stamps  # what the pause is longer than the first scan reaches
    assert looks <= 25


def test_it_goes_on_when_time_is_set_back(sender):
    sender, outbox, update = sender
    update(100.0, 100.25)
    sender.repeat_if_due(rospy.Time.from_sec(1.0))
    sender.repeat_if_due(rospy.Time.from_sec(1.5))
    assert outbox.stamps == [100.5, 2.0]


def test_a_correction_that_took_long_to_find_is_not_hidden_behind_what_was_kept_alive_meanwhile(sender, monkeypatch):
    sender, outbox, update = sender
    update(10.0, 10.25)
    sender.repeat_if_due(rospy.Time.from_sec(11.0))
    assert outbox.sent[-1] == ("map", "odom", POSE, 11.5)
    clock = rospy.Time.from_sec(11.125)
    found = POSE._replace(x=1.25)
    with monkeypatch.context() as patch:
        patch.setattr(rospy, "get_rostime", lambda: clock)
        sender.update(found, rospy.Time.from_sec(10.25))
    newest = max(outbox.sent, key=lambda one: one[3])
    assert newest == ("map", "odom", found, 11.625)
    update(11.25, 11.375)
    assert outbox.stamps[-1] == 11.75 and len(outbox.sent) == 5


def test_of_another_odometry_frame_nothing_is_said_before_a_scan_tells(sender):
    sender, outbox, update = sender
    update(10.0, 10.25)
    sender.configure("map", "odom_combined", 0.5, True)
    sender.repeat_if_due(rospy.Time.from_sec(11.0))
    assert len(outbox.sent) == 1
    update(11.0, 11.25)
    assert outbox.sent[-1] == ("map", "odom_combined", POSE, 11.5)


def test_nothing_is_sent_where_it_is_switched_off(sender):
    sender, outbox, update = sender
    sender.configure("map", "odom", 0.5, False)
    update(10.0, 10.25)
    sender.repeat_if_due(rospy.Time.from_sec(11.0))
    assert outbox.sent == []


def test_its_age_is_that_of_the_scan(sender, monkeypatch):
    sender, _, update = sender
    assert sender.age() == 0.0
    update(10.0, 10.25)
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time.from_sec(12.5))
    assert sender.age() == 2.5


def of_one_scan(monkeypatch, late=0.0, jumps=0):
    """Return what map -> odom is told of a scan, and what of odometry's jumps; the lidar's clock is off by `late` (s).
    """
    updates, told, node = [], [], amcl.AmclNode.__new__(amcl.AmclNode)
    scan = LaserScan(np.full(8, 2.0), 0.0, 0.7, 0.1, 3.0, 10.0, "laser")
    monkeypatch.setattr(amcl, "scan_in_base", lambda *_, **__: MountedScan(scan, IDENTITY, True))
    node.__dict__.update(
        _parameters=AmclParameters(save_pose_rate=0.0), _lock=threading.RLock(), _kept=None,
        _scan_watch=SimpleNamespace(
            saw=lambda _now: None, warn_of_dates=lambda _timings: None, warn_of_search=lambda _searched: None,
            warn_of_jumps=lambda *jump: told.append(jump)),
        _timings=SimpleNamespace(
            taken_at=lambda _frame, stamp: stamp - late,
            corrected=lambda scan: replace(scan, stamp=scan.stamp - late)),
        _localizer=SimpleNamespace(
            process=lambda *_: None, odometry=SimpleNamespace(jumps=jumps), map_from_odom=POSE, poses=None,
            searched=1.0),
        _map_to_odom=SimpleNamespace(update=lambda pose, stamp: updates.append((pose, stamp.to_sec()))),
        _saved_pose=SavedPose.__new__(SavedPose),
        transforms=SimpleNamespace(lookup=lambda *_: IDENTITY, frames_above=lambda *_: {}))
    message = LaserScanMessage()
    message.header.frame_id, message.header.stamp = "laser", rospy.Time(10)
    node.process(message)
    return updates, told


@pytest.mark.parametrize("late, dated", [(-0.5, 10.5), (0.0, 10.0), (0.5, 10.0)])
def test_it_is_as_young_as_the_scan_where_a_lidar_s_clock_is_behind(monkeypatch, late, dated):
    """Once known to be half a second behind, scans were set right and map -> odom was not: too old to drive by."""
    updates, _ = of_one_scan(monkeypatch, late)
    assert updates == [(POSE, pytest.approx(dated))]


def test_who_reads_the_log_hears_of_odometry_that_began_anew(monkeypatch):
    assert of_one_scan(monkeypatch, jumps=2)[1] == [(2, IDENTITY)]
