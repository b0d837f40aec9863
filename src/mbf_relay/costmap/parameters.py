"""The parameters of a costmap, by costmap_2d's names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, List, Mapping, Tuple, Type, TypeVar

import numpy as np

from mbf_relay.costmap.cost_grid import OBSTACLE_OVERLAP
from mbf_relay.costmap.outline import (
    check_padded,
    footprint_from_radius,
    notes_on,
    padded,
    parse_footprint,
    radii,
)
from mbf_relay.grid import Grid
from mbf_relay.maps import COARSEST, FINEST, too_large
from mbf_relay.parameters import ParameterSet, parameter

T = TypeVar("T", bound="CostmapParameters")
RECONFIGURABLE = (
    "transform_tolerance", "update_frequency", "publish_frequency", "width", "height", "resolution", "origin_x",
    "origin_y", "footprint", "robot_radius", "footprint_padding",
)
"""What can be changed at run time, as in costmap_2d."""


@dataclass(frozen=True)
class CostmapParameters(ParameterSet):
    """Parameters of a costmap, by costmap_2d's names; its layers' stand in groups beside them."""

    global_frame: str = parameter("map", "frame of the costmap", is_frame=True)
    robot_base_frame: str = parameter("base_link", "frame of the robot's base", is_frame=True)
    update_frequency: float = parameter(5.0, "how often the costmap is updated", unit="Hz", minimum=0.0, maximum=100.0)
    publish_frequency: float = parameter(
        0.0, "how often the costmap is published; 0 for only once to each new subscriber", unit="Hz", minimum=0.0,
        maximum=100.0)
    transform_tolerance: float = parameter(
        0.3, "largest age of the robot's pose with which the costmap is still updated", unit="s", minimum=0.0,
        maximum=10.0)
    rolling_window: bool = parameter(False, "the costmap moves with the robot")
    track_unknown_space: bool = parameter(False, "cells that no layer knows are unknown; false for free")
    always_send_full_costmap: bool = parameter(
        False, "publish the whole costmap each time; false for only what has changed")
    width: float = parameter(10.0, "width of the costmap", unit="m", above=0.0)
    height: float = parameter(10.0, "height of the costmap", unit="m", above=0.0)
    resolution: float = parameter(0.05, "side length of a cell", unit="m", above=0.0, maximum=COARSEST, clamped=False)
    origin_x: float = parameter(0.0, "x of the lower left corner", unit="m")
    origin_y: float = parameter(0.0, "y of the lower left corner", unit="m")
    footprint: Any = parameter(
        (), "outline of the robot in its base frame, [[x, y], ...]; empty for a circle of robot_radius", unit="m")
    robot_radius: float = parameter(
        0.46, "radius of a round robot, used if no footprint is given", unit="m", minimum=0.0, maximum=10.0,
        clamped=False)
    footprint_padding: float = parameter(
        0.01, "how far the footprint is extended on every side", unit="m", minimum=-10.0, maximum=10.0, clamped=False)
    obstacle_overlap: float = parameter(
        OBSTACLE_OVERLAP, "share of a cell by which the footprint may overlap an obstacle's cell, since obstacles fill "
        "half of it on average; for planner, controller and recovery alike", minimum=0.0, maximum=0.5)
    footprint_topic: str = parameter(
        "footprint", "topic on which the footprint can be changed; width and height of a rolling_window stay, and must "
        "suit the largest", is_topic=True)
    published_footprint_topic: str = parameter(
        "footprint", "topic on which the footprint at the robot's pose is published", aliases=("published_footprint",),
        is_topic=True)

    def check(self) -> None:
        parse_footprint(self.footprint)
        # raises, since dynamic_reconfigure would clamp to a declared minimum
        if self.resolution < FINEST:
            raise ValueError(f"parameter resolution is {self.resolution:g} m; it must be at least {FINEST:g} m")
        for name, side in (("width", self.width), ("height", self.height)):
            if side / self.resolution < 1.0 - 1e-9:
                raise ValueError(
                    f"parameter {name} is {side:g} m; it must be a cell at least, {self.resolution:g} m")
        grid = self.grid()
        trouble = too_large(grid.width, grid.height)
        if trouble:
            raise ValueError(
                f"parameters width and height are {self.width:g} m and {self.height:g} m, at a resolution of "
                f"{self.resolution:g} m {trouble}")
        check_padded(self.outline(), self.footprint_padding, self.resolution)

    @classmethod
    def read(cls: Type[T], values: Mapping[str, Any]) -> Tuple[T, List[str]]:
        """Read the parameters as ParameterSet.read does; widen a rolling window to twice the robot's diameter at least.

        In a smaller one, which costmap_2d accepts, the controller does not see where the robot drives, and the robot
        stands or creeps.
        """
        parameters, notes = super().read(values)
        return parameters._widened(notes)

    def reconfigured(self: T, changes: Mapping[str, Any]) -> Tuple[T, List[str]]:
        """Return a copy with changes as ParameterSet.reconfigured does, with a rolling window widened as by `read`."""
        parameters, notes = super().reconfigured(changes)
        return parameters._widened(notes)

    def _widened(self: T, notes: List[str]) -> Tuple[T, List[str]]:
        """Return a copy whose rolling window is as large as `read` says, and the notes with one on that."""
        across = 2.0 * radii(padded(self.outline(), self.footprint_padding))[1]
        width, height = (max(side, 2.0 * across) for side in (self.width, self.height))
        if not self.rolling_window or (width, height) == (self.width, self.height):
            return self, notes
        note = (
            f"parameters width and height are {self.width:g} m and {self.height:g} m; a window that moves with the "
            f"robot, {across:.2f} m across, must be twice as wide: {width:.2f} m and {height:.2f} m are used")
        return self.replace(width=width, height=height), [*notes, note]

    def read_as(self) -> List[str]:
        """Return a note on a footprint that crosses itself."""
        return notes_on(self.footprint)

    def outline(self) -> np.ndarray:
        """Return the robot's outline without padding, shape (K, 2) in metres."""
        corners = parse_footprint(self.footprint)
        return corners if len(corners) else footprint_from_radius(self.robot_radius)

    def grid(self) -> Grid:
        """Return the grid of width, height, resolution and origin, rounded down to whole cells."""
        columns, rows = int(self.width / self.resolution + 1e-9), int(self.height / self.resolution + 1e-9)
        return Grid(self.resolution, self.origin_x, self.origin_y, columns, rows)
