"""In the voxel layer's place (costmap_2d's VoxelLayer): an obstacle layer that keeps to the voxels' heights."""

from __future__ import annotations

from dataclasses import dataclass

from mbf_relay.costmap import obstacle_layer
from mbf_relay.costmap.obstacle_layer import ObstacleLayer, ObstacleLayerParameters
from mbf_relay.parameters import parameter

RECONFIGURABLE = obstacle_layer.RECONFIGURABLE + (
    "origin_z", "z_resolution", "z_voxels", "unknown_threshold", "mark_threshold")
"""What can be changed at run time, as in costmap_2d."""


@dataclass(frozen=True)
class VoxelLayerParameters(ObstacleLayerParameters):
    """Parameters of the obstacle layer and, from `origin_z` on, the voxel layer; each source has its own group."""

    origin_z: float = parameter(0.0, "height of the lowest voxel's floor", unit="m")
    z_resolution: float = parameter(0.2, "height of a voxel", unit="m", above=0.0, maximum=50.0)
    z_voxels: int = parameter(10, "how many voxels; points above the highest do not become obstacles", minimum=0)
    unknown_threshold: int = parameter(
        15, "read for costmap_2d's sake; cells here are known or not, whatever the height", minimum=0)
    mark_threshold: int = parameter(
        0, "read for costmap_2d's sake; here one point makes an obstacle, as with 0 there", minimum=0)
    publish_voxel_map: bool = parameter(False, "read for costmap_2d's sake; there are no voxels to publish")


class VoxelLayer(ObstacleLayer):
    """Marks what lies within the voxels' heights; a ray frees the cells it passes, however high above them it does."""

    Parameters = VoxelLayerParameters

    notice = (
        "keeps one plane instead of voxels: points from min_obstacle_height to the highest voxel's top mark a cell, "
        "and rays of any height free it")

    @property
    def highest_mark(self) -> float:
        parameters = self.parameters
        return min(parameters.max_obstacle_height, parameters.origin_z + parameters.z_voxels * parameters.z_resolution)
