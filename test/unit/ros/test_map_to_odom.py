"""No two transforms map -> odom have one stamp, whoever sent them."""

import pytest

rospy = pytest.importorskip("rospy")

from mbf_relay.geometry import Pose2D  # noqa: E402
from mbf_relay.ros.map_to_odom import MapToOdom  # noqa: E402


class Outbox:
    def __init__(self):
        self.stamps = []

    def send(self, parent, child, pose, stamp):
        self.stamps.append(stamp.to_nsec())


def test_a_stamp_is_not_sent_again_though_others_came_between(monkeypatch):
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time(0))  # keeps the keep-alive thread quiet
    outbox = Outbox()
    sender = MapToOdom(outbox)
    sender.configure("map", "odom", 0.5, True)
    for stamp in (69.0, 68.8, 69.0, 69.2, 69.0):
        sender.update(Pose2D(0.0, 0.0, 0.0), rospy.Time.from_sec(stamp))
    assert len(set(outbox.stamps)) == 5
    assert max(outbox.stamps) - rospy.Time.from_sec(69.7).to_nsec() < 10000
