"""Frames as the browser's view keeps them."""

import threading
from types import SimpleNamespace

import pytest
import rospy
from geometry_msgs.msg import TransformStamped
from tf2_msgs.msg import TFMessage

from mbf_relay.ros.common import tf_core
from mbf_relay.ros.web import frames as web_frames


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


def seen(frames, seconds, x, child="base_footprint", sender="/robot"):
    message = TransformStamped()
    message.header.stamp, message.header.frame_id = rospy.Time.from_sec(seconds), "map"
    message.child_frame_id, message.transform.translation.x = child, x
    message.transform.rotation.w = 1.0
    take(frames, message, sender=sender)
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


@pytest.mark.parametrize("child", ["camera", "base_footprint"])
def test_a_robot_is_still_shown_after_a_node_whose_clock_is_behind_spoke(frames, child):
    seen(frames, 100.0, 1.0)
    seen(frames, 50.0, 2.0, child, "/stranger" if child == "base_footprint" else "/robot")
    assert frames.lookup("map", "base_footprint").x == 1.0


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


def test_a_lidar_s_place_told_once_is_known_though_another_frame_was_hung_elsewhere_meanwhile(frames, monkeypatch):
    def told(parent, child, x):
        message = TransformStamped()
        message.header.frame_id, message.child_frame_id = parent, child
        message.transform.translation.x, message.transform.rotation.w = x, 1.0
        return message

    for frame in ("camera", "imu"):
        take(frames, told("map", frame, 1.0), is_static=True)
    setting, forgetting = threading.Event(), threading.Event()
    set_static = frames._known.set_transform_static

    def sets_late(transform, sender):
        setting.set()
        forgetting.wait(0.5)
        set_static(transform, sender)

    monkeypatch.setattr(frames._known, "set_transform_static", sets_late)
    lidar = threading.Thread(target=take, args=(frames, told("base", "laser", 0.5), True))
    lidar.start()
    setting.wait()

    class CoreWhileALidarSpeaks(tf_core.tf2_py.BufferCore):
        def set_transform_static(self, transform, sender):
            super().set_transform_static(transform, sender)
            forgetting.set()
            lidar.join(0.5)

    monkeypatch.setattr(tf_core.tf2_py, "BufferCore", CoreWhileALidarSpeaks)
    moving = told("map", "camera", 2.0)
    moving.header.stamp = rospy.Time(10)
    take(frames, moving)  # now by /tf, for which what /tf_static told of it must be forgotten
    lidar.join()
    assert frames.lookup("base", "laser").x == 0.5
