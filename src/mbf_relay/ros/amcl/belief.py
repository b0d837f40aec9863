"""What the amcl node tells of its belief beside the pose: hypotheses with their weights, and the pose's reliability."""

from __future__ import annotations

from typing import List, Sequence, Tuple

import rospy
from geometry_msgs.msg import PoseArray
from std_msgs.msg import Float64
from visualization_msgs.msg import Marker, MarkerArray

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.scan_search import Places
from mbf_relay.ros.common.conversions import header, pose_to_message

Hypotheses = Sequence[Tuple[Pose2D, float]]
"""Places with their shares of the belief, heaviest first."""
ARROW = (0.5, 0.08, 0.08)


class BeliefPublisher:
    """Publishes what the filter believes.

    `~hypotheses` (PoseArray, heaviest first), `~hypothesis_weights` (the same as arrows with their weights, for RViz)
    and `~reliability` (Float64: the probability that the pose is right within 0.5 m and 10 degrees).
    """

    def __init__(self) -> None:
        self._poses = rospy.Publisher("~hypotheses", PoseArray, queue_size=2, latch=True)
        self._markers = rospy.Publisher("~hypothesis_weights", MarkerArray, queue_size=2, latch=True)
        self._reliability = rospy.Publisher("~reliability", Float64, queue_size=2, latch=True)

    def publish(self, hypotheses: Hypotheses, reliability: float, frame: str, stamp: rospy.Time) -> None:
        """Publish hypotheses and the reliability of the first.

        Args:
            hypotheses: Where the robot may be.
            reliability: 0 to 1.
            frame: The poses'.
            stamp: Time of the scan they are from.
        """
        message = PoseArray(header=header(frame, stamp))
        message.poses = [pose_to_message(pose) for pose, _ in hypotheses]
        self._poses.publish(message)
        self._reliability.publish(Float64(reliability))
        if self._markers.get_num_connections():
            self._markers.publish(MarkerArray(markers=markers_of(hypotheses, frame, stamp)))


def markers_of(hypotheses: Hypotheses, frame: str, stamp: rospy.Time) -> List[Marker]:
    """Return an arrow for each hypothesis, the fainter the less it weighs, and its weight beside it as text.

    Args:
        hypotheses: Places with their weights.
        frame: The poses'.
        stamp: Time they are of.
    """
    markers = [Marker(header=header(frame, stamp), action=Marker.DELETEALL)]
    for index, (pose, weight) in enumerate(hypotheses):
        for kind, namespace in ((Marker.ARROW, "places"), (Marker.TEXT_VIEW_FACING, "weights")):
            marker = Marker(header=header(frame, stamp), ns=namespace, id=index, type=kind, action=Marker.ADD)
            marker.pose = pose_to_message(pose)
            marker.scale.x, marker.scale.y, marker.scale.z = ARROW if kind == Marker.ARROW else (0.0, 0.0, 0.2)
            marker.color.r, marker.color.g, marker.color.a = 1.0, 0.5, 0.2 + 0.8 * weight
            marker.text = f"{100.0 * weight:.0f} %"
            markers.append(marker)
    return markers


def describe_places(places: Places) -> str:
    """Return places as text, best first: one line each with x, y (m), yaw (rad) and the score, 0 to 1."""
    return "\n".join(
        f"x {pose[0]:.3f} y {pose[1]:.3f} yaw {pose[2]:.4f} score {score:.3f}" for pose, score in zip(*places)
    )
