"""Topics of amcl about its belief beside the pose: hypotheses with weights, reliability, and changes of the map."""

from __future__ import annotations

from typing import List, NamedTuple, Optional, Sequence, Tuple

import rospy
from geometry_msgs.msg import PoseArray
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import Float64
from visualization_msgs.msg import Marker, MarkerArray

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.scan_search import Places
from mbf_relay.maps import OccupancyMap
from mbf_relay.ros.common.conversions import header, map_to_message, pose_to_message

Hypotheses = Sequence[Tuple[Pose2D, float]]
"""Poses with their weights (0 to 1), heaviest first."""
ARROW = (0.5, 0.08, 0.08)
"""Length, width and height (m) of a hypothesis' arrow."""


class Belief(NamedTuple):
    """What the filter believes.

    Attributes:
        hypotheses: Poses where the robot may be.
        reliability: Probability that the first one is right; None without `robust`.
        changed: Blocks of the map that have changed; None without subscribers.
        log_likelihood: Log-likelihood of the newest scan, averaged over the particles.
        effective_particles: Effective sample size.
    """

    hypotheses: Hypotheses
    reliability: Optional[float]
    changed: Optional[OccupancyMap]
    log_likelihood: Optional[float]
    effective_particles: Optional[float]


class BeliefPublisher:
    """Publishes what the filter believes.

    `~log_likelihood` and `~effective_sample_size` (Float64: how the newest scan fits, and how many particles it left).
    With `robust` also `~hypotheses` (PoseArray, heaviest first), `~hypothesis_weights` (the same as arrows with their
    weights, for RViz), `~reliability` (Float64: the probability that the pose is right within 0.5 m and 10 degrees) and
    `~changed_blocks` (OccupancyGrid: 100 where the map is not as the scans have it, 0 where it is, -1 where not seen).
    """

    def __init__(self) -> None:
        self._poses = rospy.Publisher("~hypotheses", PoseArray, queue_size=2, latch=True)
        self._markers = rospy.Publisher("~hypothesis_weights", MarkerArray, queue_size=2, latch=True)
        self._reliability = rospy.Publisher("~reliability", Float64, queue_size=2, latch=True)
        self._blocks = rospy.Publisher("~changed_blocks", OccupancyGrid, queue_size=2)
        self._log_likelihood = rospy.Publisher("~log_likelihood", Float64, queue_size=2)
        self._effective = rospy.Publisher("~effective_sample_size", Float64, queue_size=2)

    def take(self, localizer: Localizer) -> Belief:
        """Return a filter's belief, without what has no subscribers; the filter's lock must be held."""
        changed = localizer.changed_blocks() if self._blocks.get_num_connections() else None
        return Belief(
            localizer.hypotheses(), localizer.reliability(), changed, localizer.log_likelihood,
            localizer.effective_particles,
        )

    def publish(self, belief: Belief, frame: str, stamp: rospy.Time) -> None:
        """Publish a belief.

        Args:
            belief: From `take`.
            frame: The map's.
            stamp: Time of the scan it is from.
        """
        for publisher, value in (
            (self._log_likelihood, belief.log_likelihood), (self._effective, belief.effective_particles)
        ):
            if value is not None:
                publisher.publish(Float64(value))
        if belief.reliability is None:
            return
        message = PoseArray(header=header(frame, stamp))
        message.poses = [pose_to_message(pose) for pose, _ in belief.hypotheses]
        self._poses.publish(message)
        self._reliability.publish(Float64(belief.reliability))
        if self._markers.get_num_connections():
            self._markers.publish(MarkerArray(markers=markers_of(belief.hypotheses, frame, stamp)))
        if belief.changed is not None:
            self._blocks.publish(map_to_message(belief.changed, frame, stamp))


def markers_of(hypotheses: Hypotheses, frame: str, stamp: rospy.Time) -> List[Marker]:
    """Return an arrow for each hypothesis, with its weight as opacity and as text beside it.

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
        f"x {pose[0]:.3f} y {pose[1]:.3f} yaw {pose[2]:.4f} score {score:.3f}"
        for pose, score in zip(places.poses, places.scores)
    )
