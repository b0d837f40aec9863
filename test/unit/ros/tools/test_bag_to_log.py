"""Logs made of bags in which not everything is as it should be."""

import pytest

pytest.importorskip("mbf_msgs", reason="needs the built package")

import rosbag  # noqa: E402
import rospy  # noqa: E402
from geometry_msgs.msg import Transform, TransformStamped  # noqa: E402
from sensor_msgs.msg import LaserScan  # noqa: E402
from std_msgs.msg import Header  # noqa: E402
from tf2_msgs.msg import TFMessage  # noqa: E402

from mbf_relay.ros.tools.bag_to_log import main  # noqa: E402


def transform(parent, child, stamp):
    message = TransformStamped(Header(0, rospy.Time(stamp), parent), child, Transform())
    message.transform.rotation.w = 1.0
    return message


@pytest.fixture
def bag(tmp_path):
    """Return a bag of ten scans, of which odometry covers the first four, and the third has another beam."""
    path = tmp_path / "drive.bag"
    with rosbag.Bag(str(path), "w") as bag:
        fixed = TFMessage([transform("base_link", "laser", 1)])
        bag.write("/tf_static", fixed, rospy.Time(1))
        for second in range(1, 5):
            bag.write("/tf", TFMessage([transform("odom", "base_link", second)]), rospy.Time(second))
        for second in range(1, 11):
            beams = 5 if second == 3 else 4
            header = Header(0, rospy.Time(second), "laser")
            scan = LaserScan(header, 0.0, beams - 1.0, 1.0, 0.0, 0.1, 0.1, 5.0, [1.0] * beams, [])
            bag.write("scan", scan, rospy.Time(second))
    return path


def test_a_log_of_a_third_of_a_drive_is_not_taken_for_the_whole(bag, tmp_path, capsys):
    """Localization was judged by scans of the first metres, and nothing told that the rest was not in the log."""
    assert main([str(bag), str(tmp_path / "log.npz")]) == 0
    told = capsys.readouterr()
    assert "3 scans of 4 beams written" in told.out
    assert "7 of 10 scans left out, the first because it has 5 beams, and the first has 4" in told.err


@pytest.mark.parametrize("name", ["scan", "/scan"])
def test_a_topic_is_found_with_its_slash_and_without(bag, tmp_path, name):
    """rosbag keeps names as they were asked for; `--scan /scan` found none of the scans."""
    assert main([str(bag), str(tmp_path / "log.npz"), "--scan", name]) == 0


def test_of_a_topic_that_is_not_there_those_are_named_that_are(bag, tmp_path, capsys):
    assert main([str(bag), str(tmp_path / "log.npz"), "--scan", "/front"]) == 1
    assert "has scan with laser scans; choose one by --scan" in capsys.readouterr().err
