"""Point clouds as localization takes them: judged, turned into the robot's frame, and refused in one line."""

import math
from io import BytesIO

import numpy as np
import pytest
import rospy
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import PointCloud2, PointField

from mbf_relay.localization.cloud_scan import CloudParameters
from mbf_relay.ros.amcl import cloud_input
from mbf_relay.ros.amcl.cloud_input import scan_of_cloud
from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.message_queue import MessageQueue

VALUES = CloudParameters(angle_increment=math.pi / 4.0, min_height=0.2, max_height=0.8)


class Tilted:
    """A camera half a metre up that looks straight ahead: z forward, x to the right, y down, as cameras have it."""

    def lookup_message(self, _target, _source, **_):
        made = TransformStamped()
        turned, moved = made.transform.rotation, made.transform.translation
        turned.x, turned.y, turned.z, turned.w = -0.5, 0.5, -0.5, 0.5
        moved.x, moved.z = 0.1, 0.5
        return made


class Panning:
    """A camera, level with its x axis ahead, that is panned to the left by 1 rad/s and now looks there."""

    def lookup_message(self, _target, _source, stamp=10.0, **_):
        made = TransformStamped()
        made.header.stamp = rospy.Time.from_sec(stamp)
        yaw = 0.5 * math.pi + stamp - 10.0
        made.transform.rotation.z, made.transform.rotation.w = math.sin(0.5 * yaw), math.cos(0.5 * yaw)
        return made


def cloud(points, frame="camera", kind=np.float32, rows=1):
    data = np.array(points, dtype=kind).reshape(-1, 3)
    made = PointCloud2(height=rows, width=len(data) // rows, point_step=3 * data.itemsize)
    made.row_step, made.data = made.width * made.point_step, data.tobytes()
    datatype = PointField.FLOAT32 if data.itemsize == 4 else PointField.FLOAT64
    made.fields = [PointField(name, index * data.itemsize, datatype, 1) for index, name in enumerate("xyz")]
    made.header.frame_id = frame
    return made


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_camera_that_looks_ahead_sees_a_wall_ahead(kind):
    made = scan_of_cloud(cloud([(0.0, 0.1, 2.0), (0.5, -5.0, 1.0)], kind=kind), VALUES, Tilted(), "base_link")
    ahead = np.nonzero(np.isfinite(made.scan.ranges))[0]
    assert made.scan.ranges[ahead] == pytest.approx([2.0], abs=1e-6)
    assert abs(made.scan.angles[ahead[0]]) <= math.pi / 8.0 + 1e-9
    assert made.laser_pose[:] == pytest.approx((0.1, 0.0, 0.0))
    assert made.scan.frame == made.header.frame_id == "camera"


def test_a_camera_that_is_panned_sees_a_wall_where_it_looked_when_the_cloud_was_taken():
    """What it saw counted as aside by as much as it had been turned until the cloud came."""
    message = cloud([(2.0, 0.0, 0.5)])
    message.header.stamp = rospy.Time.from_sec(10.0 - 0.25 * math.pi)
    made = scan_of_cloud(message, VALUES, Panning(), "base_link")
    seen, = np.nonzero(np.isfinite(made.scan.ranges))[0]
    assert abs(made.scan.angles[seen] - 0.25 * math.pi) <= math.pi / 8.0 + 1e-6


def test_clouds_in_rows_are_read_row_by_row():
    points = [(0.0, 0.0, 1.0 + 0.1 * index) for index in range(6)]
    made = scan_of_cloud(cloud(points, rows=2), VALUES, Tilted(), "base_link")
    assert np.nanmin(made.scan.ranges) == pytest.approx(1.0, abs=1e-6)


def test_what_cannot_be_read_is_refused_in_a_sentence():
    short, nameless, flat = cloud([(0.0, 0.0, 1.0)]), cloud([], frame=""), cloud([(0.0, 0.0, 1.0)])
    short.data, flat.fields = short.data[:8], flat.fields[:2]
    for wrong in (short, nameless, flat):
        with pytest.raises(InvalidMessage):
            scan_of_cloud(wrong, VALUES, Tilted(), "base_link")


def test_two_cameras_count_as_two_lidars():
    """Each has seen something else; neither must be taken for a newer look of the other."""
    queue = MessageQueue()
    for frame in ("front", "rear", "front"):
        queue.put(scan_of_cloud(cloud([(0.0, 0.0, 1.0)], frame=frame), VALUES, Tilted(), "base_link"))
    assert sorted(one.header.frame_id for one in queue.take(lambda _: True, 0.0)) == ["front", "rear"]


def test_each_radar_of_a_ring_whose_clouds_come_in_one_piece_is_heard(monkeypatch):
    """Of what comes in one piece rospy keeps as many as the queue is long: all radars but the last saw nothing."""
    options, queue, piece, came = {}, MessageQueue(), BytesIO(), []
    monkeypatch.setattr(cloud_input.rospy, "Subscriber", lambda *_, **given: options.update(given))
    monkeypatch.setattr(cloud_input.rospy, "get_time", lambda: 1.0)
    heard = cloud_input.CloudInput(VALUES, queue, Tilted(), lambda: "base_link")
    for frame in ("ahead", "astern", "port", "starboard"):
        echoes = cloud([(0.0, 0.0, 1.0)], frame)
        echoes.header.stamp = rospy.Time(1)
        rospy.msg.serialize_message(piece, 0, echoes)
    rospy.msg.deserialize_messages(piece, came, PointCloud2, queue_size=options["queue_size"])
    for message in came:
        heard._take(message)
    assert [one.header.frame_id for one in queue.take(lambda _: True, 0.0)] == ["ahead", "astern", "port", "starboard"]
