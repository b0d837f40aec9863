"""What any node on the network may send: each message becomes something sound, or one line that refuses it."""

import genpy
import numpy as np
import pytest
import rosbag
from geometry_msgs.msg import Pose, TransformStamped, Twist
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mbf_msgs.msg import ExePathGoal, GetPathGoal, MoveBaseGoal, RecoveryGoal
from nav_msgs.msg import OccupancyGrid
from nav_msgs.msg import Path as PathMessage
from random_messages import message
from sensor_msgs.msg import LaserScan, PointCloud, PointCloud2, PointField
from tally import how_many, trial

from mbf_relay.localization.cloud_scan import CloudParameters
from mbf_relay.outcomes import NavigationError
from mbf_relay.ros.amcl.cloud_input import scan_of_cloud
from mbf_relay.ros.common import bags, conversions
from mbf_relay.ros.costmap.inputs import points_from
from mbf_relay.ros.server import messages

EXAMPLES = how_many(30, 5000)


def fitting_grid(grid):
    """Return a grid with as many cells as it says, where those are few."""
    cells = grid.info.width * grid.info.height
    if cells <= 64:
        grid.data = [-1, 0, 100][:cells] + [50] * max(0, cells - 3)
    return grid


def is_sound(made):
    """Return whether what came of a message can be reckoned with."""
    for name in ("poses", "data", "angles"):
        if hasattr(made, name) and not np.isfinite(np.asarray(getattr(made, name), dtype=float)).all():
            return False
    return made.is_finite() if hasattr(made, "is_finite") else True


def checked_transform(transform):
    """Return a transform as it comes out of tf, which is handed only what was checked."""
    conversions.take_transform(transform)
    return conversions.transform_from_message(transform.transform)


def coloured(cloud):
    """Return a cloud of points as cameras send them, its sizes as they came."""
    cloud.fields = [PointField(name, 4 * index, PointField.FLOAT32, 1) for index, name in enumerate("xyz")]
    cloud.header.frame_id = "camera"
    if cloud.width * cloud.height <= 8:
        cloud.point_step, cloud.row_step = 12, 12 * cloud.width
        cloud.data = (bytes(cloud.data) + bytes(96))[:cloud.row_step * cloud.height]
    return cloud


class Mounted:
    """A tree of transforms in which every sensor sits half a metre above the base."""

    def lookup_message(self, _target, _source, **_):
        mounted = TransformStamped()
        mounted.transform.rotation.w, mounted.transform.translation.z = 1.0, 0.5
        return mounted


def scan_of_a(cloud):
    """Return the scan a cloud comes to, its directions without a reading filled in."""
    scan = scan_of_cloud(cloud, CloudParameters(), Mounted(), "base_link").scan
    assert not np.isinf(scan.ranges).any()
    return scan


CONVERSIONS = {
    "pose": (message(Pose), conversions.pose_from_message),
    "transform": (message(TransformStamped), checked_transform),
    "velocity": (message(Twist), conversions.twist_from_message),
    "path": (message(PathMessage), conversions.path_from_message),
    "grid": (message(OccupancyGrid), conversions.map_from_message),
    "grid that fits": (message(OccupancyGrid).map(fitting_grid), conversions.map_from_message),
    "scan": (message(LaserScan), conversions.scan_from_message),
    "scan as points": (message(LaserScan), lambda scan: points_from(scan, conversions.scan_from_message(scan), True)),
    "cloud": (message(PointCloud), lambda cloud: points_from(cloud, None, True)),
    "cloud of bytes": (message(PointCloud2), lambda cloud: points_from(cloud, None, True)),
    "cloud as a scan": (message(PointCloud2).map(coloured), lambda cloud: scan_of_a(cloud)),
    "goal of move_base": (message(MoveBaseGoal), messages.navigate_goal),
    "goal of get_path": (message(GetPathGoal), messages.plan_goal),
    "goal of exe_path": (message(ExePathGoal), messages.follow_goal),
    "goal of recovery": (message(RecoveryGoal), messages.recover_goal),
}


@pytest.mark.parametrize("name", CONVERSIONS)
def test_a_node_outlives_whatever_is_sent(name):
    strategy, convert = CONVERSIONS[name]

    @given(sent=strategy)
    @settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck))
    @trial("messages of any kind converted")
    def converted_or_refused(sent):
        try:
            made = convert(sent)
        except (ValueError, NavigationError) as error:
            assert str(error) and len(str(error)) < 2000
        else:
            assert is_sound(made)

    converted_or_refused()


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bags") / "sound.bag"
    with rosbag.Bag(str(path), "w") as made:
        for count in range(3):
            scan = LaserScan(ranges=[1.0] * 8, angle_increment=0.1, range_max=5.0)
            scan.header.stamp = genpy.Time(10 + count)
            made.write("scan", scan, scan.header.stamp)
    return path.read_bytes()


@settings(max_examples=EXAMPLES, suppress_health_check=list(HealthCheck))
@given(changes=st.lists(st.tuples(st.integers(0, 10**6), st.integers(0, 255)), max_size=4), end=st.integers(0, 10**6))
def test_a_broken_bag_is_read_or_refused_in_a_sentence(bag, tmp_path_factory, changes, end):
    data = bytearray(bag)
    for place, value in changes:
        data[place % len(data)] = value
    path = tmp_path_factory.getbasetemp() / "broken.bag"
    path.write_bytes(bytes(data[:end % (2 * len(data))]))
    with trial("broken files read"):
        try:
            with bags.open_bag(str(path)) as opened:
                for read in bags.read_messages(opened):
                    assert read.topic
        except (ValueError, OSError) as error:
            assert str(error)
