"""A ring of sonars on one topic, whose board sends all their readings in one go."""

from io import BytesIO

import rospy.msg
from scan_source import StillFrames
from sensor_msgs.msg import Range

from mbf_relay.costmap.factory import build_costmap
from mbf_relay.ros.common.lidar_timings import LidarTimings
from mbf_relay.ros.costmap import inputs

SONARS = 16


def test_each_sonar_of_a_ring_that_speaks_at_once_is_heard(monkeypatch):
    """Of what comes in one piece rospy keeps as many as the queue is long: the first eleven sonars saw nothing."""
    options, heard = {}, []
    monkeypatch.setattr(inputs.rospy, "Subscriber", lambda *_, **given: options.update(given))
    monkeypatch.setattr(inputs.rospy, "get_time", lambda: 1.0)
    costmap = build_costmap("local_costmap", {
        "rolling_window": True, "width": 2.0, "height": 2.0,
        "plugins": [{"name": "ring", "type": "range_sensor_layer::RangeSensorLayer"}], "ring": {"topics": ["/sonar"]}})
    (name, source), = costmap.sources.items()
    frames = StillFrames()
    sensor = inputs.SensorInput(
        name, source, costmap, frames, 0.2, None, LidarTimings(frames, lambda: (costmap.robot_frame, costmap.frame)))
    monkeypatch.setattr(costmap, "observe", lambda _name, observation, _now: heard.append(observation.frame))
    piece, came = BytesIO(), []
    for number in range(SONARS):
        reading = Range(field_of_view=0.3, min_range=0.1, max_range=3.0, range=0.5)
        reading.header.frame_id, reading.header.stamp = f"sonar_{number}", rospy.Time(1)
        rospy.msg.serialize_message(piece, 0, reading)
    rospy.msg.deserialize_messages(piece, came, Range, queue_size=options["queue_size"])
    for message in came:
        sensor._keep(message)
    sensor.feed(1.0)
    assert sorted(heard) == sorted(f"sonar_{number}" for number in range(SONARS))
