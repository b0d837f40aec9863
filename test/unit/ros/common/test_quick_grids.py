"""Grid messages written as a block are the messages they stand for, byte by byte."""

import io

import numpy as np
import pytest
from map_msgs.msg import OccupancyGridUpdate
from nav_msgs.msg import OccupancyGrid

from mbf_relay.ros.common.quick_grids import QuickGrid, QuickGridUpdate


def written(message):
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def filled(kind, cells, frame):
    message = kind()
    message.header.frame_id = frame
    message.header.seq, message.header.stamp.secs = 3, 1700000000
    if isinstance(message, OccupancyGrid):
        message.info.resolution, message.info.width, message.info.height = 0.05, 7, 5
        message.info.origin.position.x, message.info.origin.orientation.w = -1.5, 1.0
    else:
        message.x, message.y, message.width, message.height = -1, 2, 7, 5
    message.data = cells
    return message


@pytest.mark.parametrize("plain, quick", [(OccupancyGrid, QuickGrid), (OccupancyGridUpdate, QuickGridUpdate)])
@pytest.mark.parametrize("frame", ["", "map", "a_rather_long_frame"])
def test_bytes_are_the_same_both_ways(plain, quick, frame):
    cells = np.random.default_rng(0).integers(-1, 101, 35).astype(np.int8)
    expected = written(filled(plain, cells.tolist(), frame))
    message = filled(quick, cells, frame)
    assert written(message) == expected == written(message)
    read = quick().deserialize(expected)
    assert (np.asarray(read.data) == cells).all() and read.header.frame_id == frame
    assert (read._md5sum, read._type) == (plain._md5sum, plain._type)
    again = plain().deserialize(written(message))
    assert list(again.data) == cells.tolist() and again == plain().deserialize(expected)


def test_an_empty_grid_and_plain_numbers_are_written_too():
    assert written(filled(QuickGrid, [], "map")) == written(filled(OccupancyGrid, [], "map"))
    assert written(filled(QuickGrid, [1, -1, 100], "map")) == written(filled(OccupancyGrid, [1, -1, 100], "map"))
