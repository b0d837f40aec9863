"""Point clouds read from where they lie are the messages that were sent."""

import io
import struct

import numpy as np
import pytest
from sensor_msgs.msg import PointCloud2, PointField

from mbf_relay.ros.common.checks import InvalidMessage
from mbf_relay.ros.common.clouds import cloud_points
from mbf_relay.ros.common.quick_clouds import QuickCloud


def cloud(rows, columns, frame="camera", gap=0, spare=0, order="<", kind="f4"):
    """Return the bytes of a cloud with so many bytes between its rows and behind its points, and the points."""
    rng = np.random.default_rng(rows + columns)
    points = rng.normal(0.0, 2.0, (rows, columns, 3)).astype(order + kind)
    width = points.itemsize
    step = 2 + 3 * width + spare
    data = np.zeros((rows, columns * step + gap), np.uint8)
    if points.size:
        cells = np.ndarray((rows, columns, step), np.uint8, data, strides=(data.shape[1], step, 1))
        cells[:, :, 2:2 + 3 * width] = points.view(np.uint8).reshape(rows, columns, -1)
    message = PointCloud2(height=rows, width=columns, point_step=step, row_step=data.shape[1], data=data.tobytes())
    message.fields = [PointField(name, 2 + index * width, PointField.FLOAT32 if kind == "f4" else PointField.FLOAT64, 1)
                      for index, name in enumerate("xyz")] + [PointField("intensity", 0, PointField.UINT8, 1)]
    message.is_bigendian, message.is_dense = order == ">", True
    message.header.frame_id, message.header.stamp.secs = frame, 1700000000
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue(), points.reshape(-1, 3).astype(float)


@pytest.mark.parametrize("form", [
    {}, {"gap": 5}, {"spare": 17}, {"frame": ""}, {"order": ">"}, {"kind": "f8", "gap": 3},
    {"order": ">", "kind": "f8"}])
@pytest.mark.parametrize("rows, columns", [(1, 7), (4, 3), (0, 0), (3, 0), (0, 3)])
@pytest.mark.parametrize("wrapped", [bytes, bytearray, lambda text: memoryview(bytearray(text))])
def test_what_was_sent_is_what_is_read(form, rows, columns, wrapped):
    text, points = cloud(rows, columns, **form)
    read, plain = QuickCloud().deserialize(wrapped(text)), PointCloud2().deserialize(text)
    assert read.header == plain.header and read.fields == plain.fields and bytes(read.data) == plain.data
    for name in ("height", "width", "is_bigendian", "point_step", "row_step", "is_dense", "_md5sum", "_type"):
        assert getattr(read, name) == getattr(plain, name)
    assert (cloud_points(read) == points).all() and (cloud_points(plain) == points).all()


@pytest.mark.parametrize("rows, columns, told", [(1, 7, 0), (1, 7, 20), (1, 7, 1000), (4, 3, 0)])
def test_a_robot_is_not_blind_with_a_camera_whose_driver_leaves_row_step_alone(rows, columns, told):
    """costmap_2d never looks at it; here each cloud was refused, and what the camera alone saw was driven into."""
    text, points = cloud(rows, columns)
    read = QuickCloud().deserialize(text)
    read.row_step = told
    assert (cloud_points(read) == points).all()


def test_a_cloud_with_fewer_bytes_than_its_rows_take_is_refused_with_both():
    read = QuickCloud().deserialize(cloud(4, 3)[0])
    for rows, told in ((4, 40), (4, 1000), (5, 0)):
        read.height, read.row_step = rows, told
        with pytest.raises(InvalidMessage, match=f"{rows} rows of {told or 42} bytes with 168 bytes"):
            cloud_points(read)


def test_a_cloud_of_no_rows_has_no_points_however_wide_it_says_they_are():
    """Ubuntu 20.04's numpy has no such array: the callback ended in a MemoryError."""
    read = QuickCloud().deserialize(cloud(0, 3)[0])
    read.width, read.row_step = 2 ** 32 - 1, 0
    assert cloud_points(read).shape == (0, 3)


def test_its_points_are_no_copy():
    text = bytearray(cloud(4, 3)[0])
    read = QuickCloud().deserialize(memoryview(text))
    before = cloud_points(read)
    text[-60:-1] = bytes(59)
    assert (cloud_points(read) != before).any()


def test_bytes_that_are_no_cloud_are_refused_as_upstream_refuses_them():
    text, _ = cloud(4, 3)
    for wrong in (b"", text[:10], text[:40], text[:-1], text[:16 + 6] + struct.pack("<I", 0xFFFFFFFF) + text[26:]):
        results = []
        for kind in (PointCloud2, QuickCloud):
            try:
                results.append(kind().deserialize(wrong).data)
            except Exception as error:
                results.append(type(error))
        assert results[0] == results[1]
