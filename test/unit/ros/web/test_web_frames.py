"""Frames as the browser's view keeps them."""

from types import SimpleNamespace

import pytest

pytest.importorskip("tf2_msgs.msg", reason="needs ROS's messages")

import rospy  # noqa: E402
from geometry_msgs.msg import TransformStamped  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

from mbf_relay.ros.web import frames as web_frames  # noqa: E402


@pytest.fixture
def frames(monkeypatch):
    class Subscriber:
        """Hears nothing; the test hands messages in."""

        def __init__(self, *_args, **_details):
            self.impl = SimpleNamespace(connections=[SimpleNamespace(callerid_pub="/robot", endpoint_id="")])

    monkeypatch.setattr(web_frames.rospy, "Subscriber", Subscriber)
    monkeypatch.setattr(web_frames.rospy, "get_time", lambda: 10.0)
    return web_frames.Frames(lambda: None)


def take(frames, transform, is_static=False, sender="/robot"):
    message = TFMessage([transform])
    message._connection_header = {"callerid": sender}
    frames._take(message, is_static)


def seen(frames, seconds, x):
    message = TransformStamped()
    message.header.stamp, message.header.frame_id = rospy.Time.from_sec(seconds), "map"
    message.child_frame_id, message.transform.translation.x = "base_footprint", x
    message.transform.rotation.w = 1.0
    take(frames, message)
    return frames.lookup("map", "base_footprint")


def test_a_robot_is_shown_from_a_simulation_s_first_second_on(frames):
    for number in range(1, 30):
        assert seen(frames, 0.5 * number, float(number)).x == number


def test_a_robot_is_shown_after_its_clock_was_set_back(frames):
    seen(frames, 100.0, 1.0)
    assert seen(frames, 1.0, 2.0).x == 2.0


def test_a_transform_somewhat_late_does_not_make_the_view_forget(frames):
    seen(frames, 100.0, 1.0)
    assert seen(frames, 95.0, 2.0).x == 1.0


def test_a_robot_is_still_shown_after_its_map_was_hung_on_it(frames):
    seen(frames, 1.0, 1.0)
    wrong = TransformStamped(child_frame_id="map")
    wrong.header.stamp, wrong.header.frame_id = rospy.Time(1), "base_footprint"
    wrong.transform.rotation.w = 1.0
    take(frames, wrong)
    assert seen(frames, 2.0, 2.0).x == 2.0
    assert frames.lookup("base_footprint", "map").x == -2.0


def test_a_frame_that_no_name_can_mean_is_not_looked_for(frames):
    assert frames.lookup("map", "base\0") is None


def test_a_lidar_is_shown_where_it_sits_after_a_stranger_put_it_elsewhere(frames):
    lidar = TransformStamped(child_frame_id="scan")
    lidar.header.frame_id, lidar.transform.translation.x, lidar.transform.rotation.w = "base_footprint", 0.1, 1.0
    seen(frames, 1.0, 2.0)
    take(frames, lidar, is_static=True)
    for is_static in (False, True):
        wrong = TransformStamped(child_frame_id="scan")
        wrong.header.stamp, wrong.header.frame_id, wrong.transform.rotation.w = rospy.Time(1), "map", 1.0
        take(frames, wrong, is_static, sender="/stranger")
        assert frames.lookup("map", "scan").x == 2.1
