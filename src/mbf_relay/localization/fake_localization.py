"""Localization from the true pose that a simulator or a motion capture system knows (fake_localization)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbf_relay.geometry import Pose2D
from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class FakeLocalizationParameters(ParameterSet):
    """Parameters of fake_localization, with its names and defaults."""

    odom_frame_id: str = parameter("odom", "frame of the odometry", is_frame=True)
    base_frame_id: str = parameter("base_link", "frame of the robot whose true pose is received", is_frame=True)
    global_frame_id: str = parameter("map", "frame of the map", is_frame=True)
    delta_x: float = parameter(0.0, "x of the map's origin in the frame of the true pose", unit="m")
    delta_y: float = parameter(0.0, "y of the map's origin in the frame of the true pose", unit="m")
    delta_yaw: float = parameter(0.0, "direction of the map's x axis in the frame of the true pose", unit="rad")
    transform_tolerance: float = parameter(
        0.1, "how far into the future map -> odom is stamped, for which it stays valid", unit="s", minimum=0.0,
        maximum=2.0)


class FakeLocalization:
    """Transforms true poses to the map's frame.

    As upstream, the world is turned by -delta_yaw before it is moved by -delta_x and -delta_y, which are therefore
    along the map's axes.
    """

    def __init__(self, parameters: FakeLocalizationParameters) -> None:
        self._map_from_world = Pose2D(
            -parameters.delta_x, -parameters.delta_y, math.remainder(-parameters.delta_yaw, math.tau))

    def on_map(self, truth: Pose2D) -> Pose2D:
        """Return the robot's pose in the map's frame for its true pose in the world's frame."""
        return self._map_from_world.compose(truth)

    def set_pose(self, pose: Pose2D, truth: Pose2D) -> None:
        """Change the transform so that the true pose `truth` (world's frame) becomes `pose` (map's frame)."""
        self._map_from_world = pose.compose(truth.inverse())
