"""What moves, on topics: each track as odometry of its own, and all of them as markers."""

from __future__ import annotations

from typing import Sequence

import rospy
from geometry_msgs.msg import Point, Vector3
from nav_msgs.msg import Odometry
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from mbf_relay.ros.common.conversions import header
from mbf_relay.tracking.track import Track

ORANGE = ColorRGBA(0.95, 0.55, 0.1, 0.6)
HEIGHT = 0.3  # m of the cylinders
AHEAD = 1.0  # s of motion that an arrow shows
LIFETIME = 0.5  # s after which RViz forgets a marker that is not renewed


class TracksPublisher:
    """Publishes `~NAME/tracks` (nav_msgs/Odometry, one message per track) and `~NAME/track_markers` (MarkerArray).

    A track's child frame is `track_NUMBER`; its velocity is given in the costmap's frame, as a disc has no heading.
    """

    def __init__(self, name: str) -> None:
        self._tracks = rospy.Publisher(f"~{name}/tracks", Odometry, queue_size=50)
        self._markers = rospy.Publisher(f"~{name}/track_markers", MarkerArray, queue_size=1)

    def publish(self, tracks: Sequence[Track], frame: str) -> None:
        """Publish tracks, in `frame`, while there are subscribers."""
        if self._tracks.get_num_connections():
            for track in tracks:
                self._tracks.publish(odometry_of(track, frame))
        if self._markers.get_num_connections():
            self._markers.publish(MarkerArray([marker for track in tracks for marker in markers_of(track, frame)]))


def odometry_of(track: Track, frame: str) -> Odometry:
    """Return a track as a message: position, velocity and their variances."""
    message = Odometry(header=header(frame, track.stamp), child_frame_id=f"track_{track.number}")
    message.pose.pose.position.x, message.pose.pose.position.y = track.x, track.y
    message.pose.pose.orientation.w = 1.0
    message.twist.twist.linear.x, message.twist.twist.linear.y = track.vx, track.vy
    for values, variance in (
        (message.pose.covariance, track.position_variance), (message.twist.covariance, track.velocity_variance),
    ):
        values[0] = values[7] = variance
    return message


def markers_of(track: Track, frame: str) -> Sequence[Marker]:
    """Return a cylinder at a track's position, and an arrow to its position AHEAD seconds later."""
    disc = Marker(header=header(frame, track.stamp), ns="tracks", id=track.number, type=Marker.CYLINDER, color=ORANGE)
    disc.pose.position.x, disc.pose.position.y, disc.pose.position.z = track.x, track.y, HEIGHT / 2.0
    disc.pose.orientation.w = 1.0
    disc.scale = Vector3(2.0 * track.radius, 2.0 * track.radius, HEIGHT)
    arrow = Marker(header=header(frame, track.stamp), ns="motion", id=track.number, type=Marker.ARROW, color=ORANGE)
    arrow.pose.orientation.w = 1.0
    arrow.points = [
        Point(track.x, track.y, HEIGHT),
        Point(track.x + AHEAD * track.vx, track.y + AHEAD * track.vy, HEIGHT),
    ]
    arrow.scale = Vector3(0.03, 0.06, 0.06)
    for marker in (disc, arrow):
        marker.lifetime = rospy.Duration.from_sec(LIFETIME)
    return disc, arrow
