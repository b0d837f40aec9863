"""What amcl's diagnostics say of its scans."""

import numpy as np
import pytest
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.node_parameters import AmclParameters
from mbf_relay.ros.amcl import health
from mbf_relay.ros.amcl.health import ScanWatch, missing_transform
from mbf_relay.ros.common import diagnostics
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.ros.common.message_queue import MessageQueue
from mbf_relay.ros.common.transforms import Transforms
from mbf_relay.scan_sweep import BACKWARDS
from mbf_relay.scan_timing import ScanTiming


def no_timings():
    return LidarTimings(transforms_of(), lambda: ("base_link", "odom"))


def watch(*stamps):
    made = ScanWatch()
    for stamp in stamps:
        made.saw(stamp)
    return made


@pytest.mark.parametrize(
    "stamps, now, has_map, match, waiting, level, words",
    [
        ((0.0, 0.2, 0.4), 0.5, True, 0.97, False, diagnostics.OK, "scans are used"),
        ((0.0, 0.2, 0.4), 0.5, True, None, False, diagnostics.OK, "scans are used"),
        ((0.0, 0.2, 0.4), 0.5, True, 0.3, False, diagnostics.WARN, "only 30 % of the scan"),
        ((0.0, 0.2, 0.4), 3.4, True, 0.97, False, diagnostics.ERROR, "no scan for 3.0 s: none comes"),
        ((0.0, 0.2, 0.4), 3.4, True, 0.97, True, diagnostics.ERROR, "the transform at its time is missing"),
        ((0.0, 5.0, 10.0), 14.0, True, 0.97, False, diagnostics.OK, "scans are used"),
        ((), 1.0, True, None, False, diagnostics.ERROR, "no scan yet"),
        ((0.0, 0.2), 0.3, False, None, False, diagnostics.ERROR, "no map yet"),
    ],
)
def test_levels_mean_something(stamps, now, has_map, match, waiting, level, words):
    told = watch(*stamps).report(now, has_map, match, waiting, no_timings())
    assert told[0] == level and words in told[1]


@pytest.mark.parametrize("deviations, level", [
    ((0.1, 0.2, 0.05), diagnostics.OK), ((0.3, 0.1, 0.05), diagnostics.WARN), ((0.1, 0.1, 0.2), diagnostics.WARN)])
def test_who_looks_after_a_robot_is_told_that_it_is_not_sure_where_it_is(deviations, level):
    parameters = AmclParameters(std_warn_level_x=0.2, std_warn_level_y=0.3, std_warn_level_yaw=0.1)
    told = health.deviation_report(parameters, np.diag(np.square(deviations)), {})
    assert told[0] == level and [told[2][f"std_{axis}"] for axis in ("x", "y", "yaw")] == pytest.approx(deviations)


def test_values_are_told_whatever_the_level():
    _, _, values = watch(0.0, 0.2, 0.4).report(0.5, True, 0.914, False, no_timings())
    assert values["share of the scan on the map's walls [%]"] == "91"
    assert values["scans [Hz]"] == "5.0" and values["age of the last scan [s]"] == "0.10"


def test_it_is_told_once_where_odometry_begins_anew(monkeypatch):
    """A robot whose base's driver was restarted again and again drove on, and nothing said so."""
    told, made = [], ScanWatch()
    monkeypatch.setattr(rospy, "logwarn", lambda text, *values: told.append(text % values))
    for jumps in 0, 0, 1, 1, 2:
        made.warn_of_jumps(jumps, Pose2D(0.1, 0.0, -0.3))
    assert len(told) == 2 and "odometry has jumped to x 0.10, y 0.00, yaw -0.30" in told[0]


def transforms_of(*known):
    """Return transforms that know those from the first frame to the second at the third's time (s)."""
    made = Transforms.__new__(Transforms)
    made._listener = None
    made.buffer = tf2_ros.Buffer(debug=False)
    for parent, child, stamp in known:
        message = TransformStamped(header=Header(frame_id=parent, stamp=rospy.Time(stamp)), child_frame_id=child)
        message.transform.rotation.w = 1.0
        made.buffer.set_transform(message, "test")
    return made


def what_is_told(monkeypatch, frame, *known):
    """Return the warnings about a scan of 10 s in a frame."""
    told, made, transforms = [], watch(), transforms_of(*known)
    monkeypatch.setattr(health.time, "monotonic", lambda: made._last + 2.0 * health.SILENCE)
    monkeypatch.setattr(health.rospy, "resolve_name", lambda name: f"/{name}")
    monkeypatch.setattr(health.rospy, "logwarn_throttle", lambda _period, text: told.append(text))
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    monkeypatch.setattr(rospy.rostime, "_rostime_current", rospy.Time(10.0))
    queue = MessageQueue()
    queue.put(LaserScan(header=Header(frame_id=frame, stamp=rospy.Time(10.0))))
    made.warn_of_silence(queue, lambda message: missing_transform(transforms, AmclParameters(), message))
    return told


def test_tf_is_not_blamed_for_a_long_search(monkeypatch):
    """Somebody who asked for a search of a large map was told to look for a missing transform, and found none."""
    clock, told, made, queue = [100.0], [], watch(), MessageQueue()
    monkeypatch.setattr(health.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(health.rospy, "resolve_name", lambda name: f"/{name}")
    monkeypatch.setattr(health.rospy, "logwarn_throttle", lambda _period, text: told.append(text))
    made.worked()
    clock[0] += 3.0 * health.SILENCE  # of a search, in which scans came
    made.worked()
    queue.put(LaserScan(header=Header(frame_id="laser", stamp=rospy.Time(10.0))))
    made.warn_of_silence(queue, lambda _message: "no transform")
    assert not told
    clock[0] += 2.0 * health.SILENCE
    made.warn_of_silence(queue, lambda _message: "no transform")
    assert told == ["scans on /scan wait for 30 s: no transform"]


def test_of_a_search_that_could_not_look_everywhere_it_is_told_once(monkeypatch):
    told, made = [], ScanWatch()
    monkeypatch.setattr(rospy, "logwarn", lambda text, *values: told.append(text % values))
    for searched in 1.0, 0.062, 0.062, 0.062, 1.0:
        made.warn_of_search(searched)
    assert len(told) == 1 and "6.2 % was looked at" in told[0]


@pytest.mark.parametrize("known, words", [
    ([("odom", "base_link", 10.0)], ["from 'laser' to 'base_link'", "does not exist"]),
    ([("base_link", "laser", 10.0)], ["from 'base_link' to 'odom'", "does not exist"]),
    ([("base_link", "laser", 10.0), ("odom", "base_link", 8.0)], ["from 'base_link' to 'odom'", "extrapolation"]),
])
def test_of_a_scan_that_waits_is_told_which_transform_is_missing(monkeypatch, known, words):
    """Lidar's, robot's and odometry's frame were named, and not which of them tf does not know."""
    (told,) = what_is_told(monkeypatch, "laser", *known)
    assert told.startswith("scans on /scan wait for 30 s: no transform ")
    for word in words:
        assert word in told


def test_a_scan_in_a_frame_of_two_million_characters_waits_without_filling_the_log(monkeypatch):
    (told,) = what_is_told(monkeypatch, "a" * 2000000)
    assert "no transform from 'aaa" in told and len(told) < 600


def test_a_robot_whose_lidar_is_dated_by_another_clock_is_told_once_and_as_long_as_it_is(monkeypatch):
    """It looked for itself where it was not in each turn, and took three times as long to its goal; nobody knew why."""
    told, made, timings = [], watch(0.0, 0.2, 0.4), no_timings()
    timings._timings.update(base_scan=ScanTiming(), rear_scan=ScanTiming())
    monkeypatch.setattr(health.rospy, "logwarn", lambda form, text: told.append(form % text))
    timings._timings["base_scan"].late, timings._timings["base_scan"].order = 0.3, BACKWARDS
    for _ in range(3):
        made.warn_of_dates(timings)
    level, words, values = made.report(0.5, True, 0.97, False, timings)
    assert told == [words] and level == diagnostics.WARN
    assert words.startswith("scans of base_scan are dated 0.30 s later than odometry, as both turn")
    assert values["scans of base_scan are dated late by [s]"] == "0.30"
    assert values["scans of rear_scan are dated late by [s]"] == "unknown"
    assert values["beams of base_scan are taken"] == "the last one first"
    assert values["beams of rear_scan are taken"] == "unknown"
    assert "dated 0.25 s earlier than odometry" in health.misdated("base_scan", -0.25)
