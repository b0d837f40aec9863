"""Where a robot is on the map by what a simulator or a motion capture system knows, in place of a filter."""

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
    """Places true poses on the map.

    As upstream, the world is turned by -delta_yaw before it is moved by -delta_x and -delta_y, which are therefore
    along the map's axes.
    """

    def __init__(self, parameters: FakeLocalizationParameters) -> None:
        self._map_from_world = Pose2D(
            -parameters.delta_x, -parameters.delta_y, math.remainder(-parameters.delta_yaw, math.tau))

    def on_map(self, truth: Pose2D) -> Pose2D:
        """Return where on the map the robot is that is at `truth` in the world."""
        return self._map_from_world.compose(truth)

    def set_pose(self, pose: Pose2D, truth: Pose2D) -> None:
        """Have a robot that is at `truth` in the world be at `pose` on the map, from now on."""
        self._map_from_world = pose.compose(truth.inverse())
