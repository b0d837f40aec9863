"""Logs made of bags in which not everything is as it should be."""

import math

import numpy as np
import pytest
import rosbag
import rospy
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from mbf_relay.localization.logs import load_log
from mbf_relay.ros.tools.bag_to_log import main


def transform(parent, child, stamp):
    message = TransformStamped(Header(0, rospy.Time(stamp), parent), child, Transform())
    message.transform.rotation.w = 1.0
    return message


def write(path, scans, frames=("laser",)):
    """Write a bag of scans, one a second, by lidars in turn, of which odometry covers the first four."""
    with rosbag.Bag(str(path), "w") as bag:
        fixed = TFMessage([transform("base_link", frame, 1) for frame in frames])
        bag.write("/tf_static", fixed, rospy.Time(1))
        for second in range(1, 5):
            bag.write("/tf", TFMessage([transform("odom", "base_link", second)]), rospy.Time(second))
        for second, scan in enumerate(scans, 1):
            scan.header = Header(0, rospy.Time(second), frames[(second - 1) % len(frames)])
            bag.write("scan", scan, rospy.Time(second))
    return path


@pytest.fixture
def bag(tmp_path):
    scan = LaserScan(angle_max=3.0, angle_increment=1.0, range_min=0.1, range_max=5.0, ranges=[1.0] * 4)
    return write(tmp_path / "drive.bag", [scan] * 10)


def test_a_log_of_a_third_of_a_drive_is_not_taken_for_the_whole(bag, tmp_path, capsys):
    """Localization was judged by scans of the first metres, and nothing told that the rest was not in the log."""
    assert main([str(bag), str(tmp_path / "log.npz")]) == 0
    told = capsys.readouterr()
    assert "4 scans of 4 beams written" in told.out
    assert "6 of 10 scans left out, the first because" in told.err


def test_a_lidar_whose_turns_differ_in_their_number_of_beams_is_in_the_log_with_all_of_them(tmp_path, capsys):
    """Of an RPLidar's drive nearly all scans were left out."""
    scans = []
    for beams in (360, 357, 366, 360):
        step = 2.0 * math.pi / beams
        angles = -math.pi + step * np.arange(beams)
        scans.append(LaserScan(
            angle_min=-math.pi, angle_max=math.pi - step, angle_increment=step, range_min=0.1, range_max=5.0,
            ranges=2.0 + np.sin(angles)))
    assert main([str(write(tmp_path / "drive.bag", scans)), str(tmp_path / "log.npz")]) == 0
    assert "4 scans of 360 beams written" in capsys.readouterr().out
    log = load_log(tmp_path / "log.npz")
    assert log.ranges == pytest.approx(np.resize(2.0 + np.sin(log.angle_min + log.angle_increment * np.arange(360)),
                                                 (4, 360)), abs=0.02)


def test_scans_of_a_second_lidar_on_the_topic_are_not_logged_as_if_it_sat_where_the_first_does(tmp_path, capsys):
    scan = LaserScan(angle_max=3.0, angle_increment=1.0, range_min=0.1, range_max=5.0, ranges=[1.0] * 4)
    bag = write(tmp_path / "drive.bag", [scan] * 4, ["front", "back"])
    assert main([str(bag), str(tmp_path / "log.npz")]) == 0
    told = capsys.readouterr()
    assert "2 scans of 4 beams written" in told.out
    assert "2 of 4 scans left out, the first because its lidar is 'back', and a log has one, here 'front'" in told.err


@pytest.mark.parametrize("name", ["scan", "/scan"])
def test_a_topic_is_found_with_its_slash_and_without(bag, tmp_path, name):
    """rosbag keeps names as they were asked for; `--scan /scan` found none of the scans."""
    assert main([str(bag), str(tmp_path / "log.npz"), "--scan", name]) == 0


def test_of_a_topic_that_is_not_there_those_are_named_that_are(bag, tmp_path, capsys):
    assert main([str(bag), str(tmp_path / "log.npz"), "--scan", "/front"]) == 1
    assert "has scan with laser scans; choose one by --scan" in capsys.readouterr().err
