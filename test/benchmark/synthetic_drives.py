"""Made drives through made buildings, of the kind that loses a robot.

A scan only every half to whole metre, odometry that is off by a tenth of the motion and more, slips, walls and
furniture that are not on the map, people around the robot. Every number is drawn from the generator handed in.
"""

from __future__ import annotations

import math
from typing import List, NamedTuple, Tuple

import numpy as np

from benchmark.synthetic_buildings import BUILDINGS, RESOLUTION, scatter_boxes
from mbf_relay.geometry import IDENTITY, Pose2D, normalize_angle
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.laser_kernels import cast_scan
from mbf_relay.localization.logs import RecordedLog
from mbf_relay.maps import OccupancyMap

CLEARANCE = 0.35


class Rough(NamedTuple):
    """How rough a drive goes.

    Attributes:
        step: Metres from one scan to the next, about.
        odometry: Deviation of odometry as a share of the motion; half of it stays the same for the whole drive.
        slips: Share of steps at which the wheels slip by up to half of the step.
        unmapped: Share of the walls that the map does not have.
        people: People within 4 m, at each scan.
        furniture: Boxes in the building that the map does not have.
        beams: Beams of the lidar.
        range_max: Its reach (m).
        view: Its field of view (rad), ahead.
    """

    step: float = 0.75
    odometry: float = 0.12
    slips: float = 0.03
    unmapped: float = 0.15
    people: int = 3
    furniture: int = 0
    beams: int = 181
    range_max: float = 20.0
    view: float = math.pi


class MadeDrive(NamedTuple):
    """A drive, and the map to localize it on."""

    log: RecordedLog
    occupancy: OccupancyMap


def make_drive(building: str, scans: int, rough: Rough, rng: np.random.Generator) -> MadeDrive:
    """Drive through a made building.

    Args:
        building: A key of BUILDINGS.
        scans: Length of the drive.
        rough: How rough it goes.
        rng: Where chance comes from.
    """
    walls = BUILDINGS[building](rng)
    world = walls.copy()
    scatter_boxes(world, rough.furniture, 6, 24, rng)
    field = DistanceField(as_map(world), 5.0)
    way = wander(field, scans, rough.step, rng)
    around = rough.view >= 2.0 * math.pi
    bearings = np.linspace(-rough.view / 2.0, rough.view / 2.0, rough.beams, endpoint=not around)
    ranges = np.array([_measure(field, pose, bearings, rough, rng) for pose in way])
    log = RecordedLog(
        np.arange(float(scans)), spoil_odometry(np.array(way), rough, rng), ranges, float(bearings[0]),
        float(bearings[1] - bearings[0]), rough.range_max, np.array(way), IDENTITY,
    )
    return MadeDrive(log, as_map(_forget(walls, rough.unmapped, rng)))


def spoil_odometry(way: np.ndarray, rough: Rough, rng: np.random.Generator) -> np.ndarray:
    """Return what bad odometry makes of a way, shape (N, 3), starting at zero."""
    scale, drift = 1.0 + 0.5 * rough.odometry * rng.standard_normal(), 0.25 * rough.odometry * rng.standard_normal()
    pose, poses = Pose2D(0.0, 0.0, 0.0), [Pose2D(0.0, 0.0, 0.0)]
    for before, after in zip(way[:-1], way[1:]):
        motion = Pose2D(*after).relative_to(Pose2D(*before))
        driven, noise = math.hypot(motion.x, motion.y), rough.odometry * rng.standard_normal(3)
        along = scale + noise[0] - (0.5 * rng.random() if rng.random() < rough.slips else 0.0)
        turned = motion.theta * (1.0 + noise[2]) + driven * (drift + 0.25 * rough.odometry * rng.standard_normal())
        pose = pose.compose(Pose2D(motion.x * along, motion.y * along + 0.3 * noise[1] * driven, turned))
        poses.append(pose)
    return np.array(poses)


def as_map(walls: np.ndarray) -> OccupancyMap:
    """Return walls, bool of shape (H, W), as a map whose origin is not the world's."""
    return OccupancyMap(np.where(walls, 100, 0).astype(np.int8), RESOLUTION, Pose2D(-3.0, 5.0, 0.0))


def _forget(walls: np.ndarray, share: float, rng: np.random.Generator) -> np.ndarray:
    """Return walls without what lies in random squares, until so large a share is gone."""
    kept, cells = walls.copy(), np.argwhere(walls)
    while walls.sum() - kept.sum() < share * walls.sum():
        row, column = cells[rng.integers(len(cells))]
        side = rng.integers(10, 40)
        kept[max(0, row - side):row + side, max(0, column - side):column + side] = False
    return kept


def wander(field: DistanceField, scans: int, step: float, rng: np.random.Generator) -> List[Pose2D]:
    """Return a way that keeps clear of walls and rather goes on than turns."""
    poses = field.random_free_poses(2000, rng)
    pose = next(Pose2D(*p) for p in poses if _clear(field, p[0], p[1]) > 2.0 * CLEARANCE)
    way = [pose]
    while len(way) < scans:
        length = step * rng.uniform(0.6, 1.3)
        options: List[Tuple[float, Pose2D]] = []
        for turn in rng.uniform(-2.4, 2.4, 24):
            heading = normalize_angle(pose.theta + turn)
            ahead = [
                (pose.x + s * math.cos(heading), pose.y + s * math.sin(heading)) for s in np.linspace(0.1, length, 6)
            ]
            if min(_clear(field, x, y) for x, y in ahead) > CLEARANCE:
                value = abs(turn) - 0.5 * _clear(field, *ahead[-1]) + rng.exponential(0.3)
                options.append((value, Pose2D(ahead[-1][0], ahead[-1][1], heading)))
        pose = (
            min(options)[1] if options else Pose2D(pose.x, pose.y, normalize_angle(pose.theta + rng.uniform(0.5, 2.5)))
        )
        way.append(pose)
    return way


def _clear(field: DistanceField, x: float, y: float) -> float:
    column, row = field.occupancy.local_grid.cell_at(x - field.origin.x, y - field.origin.y)
    if not field.occupancy.local_grid.contains_cell(column, row):
        return 0.0
    return float(field.cell_distances[field.codes[row, column]])


def _measure(
    field: DistanceField, pose: Pose2D, bearings: np.ndarray, rough: Rough, rng: np.random.Generator
) -> np.ndarray:
    ranges = np.empty(len(bearings))
    cast_scan(np.array([pose]), field.blocked, field.frame, rough.range_max, bearings, ranges)
    ranges = np.where(ranges < rough.range_max, ranges + rng.normal(0.0, 0.02, len(ranges)), np.inf)
    for _ in range(rough.people):
        distance, direction = rng.uniform(0.5, 4.0), rng.uniform(-math.pi / 2.0, math.pi / 2.0)
        seen = np.abs(bearings - direction) < math.atan2(0.25, distance)
        ranges[seen] = np.minimum(ranges[seen], distance)
    return ranges
