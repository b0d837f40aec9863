"""map -> odom is dated ahead, no two have one stamp, and it goes on where scans do not."""

import pytest

rospy = pytest.importorskip("rospy")

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.ros.amcl.map_to_odom import PAUSE, MapToOdom  # noqa: E402

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
    sender.look(rospy.Time.from_sec(9.0))
    assert outbox.sent == []  # nothing is known yet
    update(10.0, 10.25)
    sender.look(rospy.Time.from_sec(10.25 + PAUSE))
    assert outbox.stamps == [10.5]
    sender.look(rospy.Time.from_sec(10.75))
    assert outbox.stamps == [10.5, 11.25]
    sender.look(rospy.Time.from_sec(10.875))
    assert outbox.stamps == [10.5, 11.25]  # far enough ahead still


def test_who_looks_when_it_says_that_it_is_due_never_lets_it_fall_behind_and_looks_seldom(sender):
    sender, outbox, update = sender
    update(10.0, 10.25)
    now, looks = 10.25, 0
    while now < 13.0:
        due = sender.look(rospy.Time.from_sec(now))
        looks, now = looks + 1, now + max(due, 0.02)
        assert now < max(outbox.stamps) + 0.1, outbox.stamps  # what the pause is longer than the first scan reaches
    assert looks <= 25


def test_it_goes_on_when_time_is_set_back(sender):
    sender, outbox, update = sender
    update(100.0, 100.25)
    sender.look(rospy.Time.from_sec(1.0))
    sender.look(rospy.Time.from_sec(1.5))
    assert outbox.stamps == [100.5, 2.0]


def test_a_correction_that_took_long_to_find_is_not_hidden_behind_what_was_kept_alive_meanwhile(sender, monkeypatch):
    sender, outbox, update = sender
    update(10.0, 10.25)
    sender.look(rospy.Time.from_sec(11.0))
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
    sender.look(rospy.Time.from_sec(11.0))
    assert len(outbox.sent) == 1
    update(11.0, 11.25)
    assert outbox.sent[-1] == ("map", "odom_combined", POSE, 11.5)


def test_nothing_is_sent_where_it_is_switched_off(sender):
    sender, outbox, update = sender
    sender.configure("map", "odom", 0.5, False)
    update(10.0, 10.25)
    sender.look(rospy.Time.from_sec(11.0))
    assert outbox.sent == []


def test_its_age_is_that_of_the_scan(sender, monkeypatch):
    sender, _, update = sender
    assert sender.age() == 0.0
    update(10.0, 10.25)
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time.from_sec(12.5))
    assert sender.age() == 2.5
