"""Walls as buildings have them: a face on either side, and a lidar that sees one of the two."""

import math

import numpy as np
import pytest
from synthetic_room import scan_at

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.distance_field import DistanceField, is_free
from mbf_relay.localization.gaussians import PoseGaussian
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.refinement_kernels import FROM_BEHIND, NEAR, ONE_WAY, credit_from_behind
from mbf_relay.localization.scan_likelihood import ScanLikelihood
from mbf_relay.maps import OccupancyMap

PLACE = Pose2D(6.0, 4.0, 0.0)


def house():
    """Return a corner of a house: walls 0.15 m thick with rooms behind them, and the four legs of a table."""
    data = np.zeros((240, 240), dtype=np.int8)
    for wall in ((slice(50, 53), slice(None)), (slice(None), slice(140, 143))):
        data[wall] = 100
    data[51, :], data[:, 141] = -1, -1
    for row, column in ((95, 75), (95, 102), (110, 75), (110, 102)):
        data[row, column] = 100
    return OccupancyMap(data, 0.05, IDENTITY)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_robot_that_turns_on_the_spot_stays_there(seed):
    """It was told to be 13 cm aside, and back, and again: shifted by a wall's thickness, all it sees fits as well.

    In the house of the TurtleBot3's tutorials it turned to and fro before its goal until it was given up.
    """
    occupancy, rng = house(), np.random.default_rng(seed)
    made = Localizer(LocalizerParameters(update_min_a=0.2), occupancy, np.random.default_rng(seed))
    made.set_initial_pose(PLACE, np.diag([0.25, 0.25, 0.07]))
    errors = []
    for turn in np.concatenate((np.arange(0.0, 9.0, 0.3), np.arange(9.0, 0.0, -0.3), np.arange(0.0, 9.0, 0.3))):
        truth = Pose2D(PLACE.x, PLACE.y, math.remainder(turn, 2.0 * math.pi))
        told = made.process(Pose2D(0.0, 0.0, truth.theta), scan_at(occupancy, truth, rng, 360, 3.5), IDENTITY)
        if told is not None:
            errors.append(told.pose.distance_to(truth))
    assert len(errors) > 80 and max(errors) < 0.06


def test_of_places_a_wall_s_thickness_apart_the_one_is_taken_from_which_faces_look_back():
    occupancy = house()
    likelihood, scan = ScanLikelihood(DistanceField(occupancy, 2.0), 0.2), scan_at(occupancy, PLACE, None, 360, 3.5)
    hit = np.isfinite(scan.ranges)
    ends = np.stack((np.cos(scan.angles[hit]), np.sin(scan.angles[hit])), axis=1) * scan.ranges[hit, None]
    aside = np.array([PLACE.x + 0.11, PLACE.y - 0.11, 0.0])
    prior = PoseGaussian(aside, np.diag([0.1, 0.1, 0.05]) ** 2)
    assert likelihood.sharpest(aside[None], prior, ends)[1] < PLACE.y - 0.05  # where nothing else is known
    for starts in ((aside, PLACE), (PLACE, aside)):
        assert likelihood.sharpest(np.array(starts, dtype=float), prior, ends) == pytest.approx(PLACE, abs=0.03)


@pytest.mark.parametrize("seed", range(6))
def test_what_is_seen_from_behind_is_what_plain_numpy_says(seed):
    rng = np.random.default_rng(seed)
    data = rng.choice(np.array([0, 0, 0, 100, -1], dtype=np.int8), (30, 40))
    field = DistanceField(OccupancyMap(data, 0.1, Pose2D(0.3, -0.2, 0.4)), 2.0)
    poses = field.random_free_poses(5, rng)
    ends = rng.uniform(-2.0, 2.0, (60, 2))
    table, outside = rng.uniform(-2.0, 0.0, 1 << 16).astype(np.float32), -2.5
    sums = np.empty(len(poses))
    credit_from_behind(poses, ends, field.codes, field.occupancy.data, field.frame, table, outside, sums)
    assert sums == pytest.approx([plain(field, pose, ends, table, outside) for pose in poses], abs=1e-4)
    assert (sums != 0.0).any()


def plain(field, pose, ends, table, outside):
    distances, free = field.face_distances[field.codes], is_free(field.occupancy.data)
    local = Pose2D(*pose).relative_to(field.origin)
    total = 0.0
    for arm in ends:
        cell = np.array(local.transform_points(arm[None])[0]) / field.resolution
        x, y = np.floor(cell).astype(int)
        if not (min(cell) >= NEAR + 1 and cell[0] < free.shape[1] - NEAR - 1 and cell[1] < free.shape[0] - NEAR - 1):
            continue
        around = [(u * u + v * v, x + u, y + v) for v in range(-NEAR, NEAR + 1) for u in range(-NEAR, NEAR + 1)]
        faces = [each for each in around if distances[each[2], each[1]] == 0.0 and each[0] <= NEAR * NEAR]
        if not faces:
            continue
        _, x, y = min(faces, key=lambda face: face[0])
        look = np.zeros(2)
        for v in (-1, 0, 1):
            for u in (-1, 0, 1):
                if (u or v) and free[y + v, x + u]:
                    look += np.array([u, v]) / math.hypot(u, v)
        way = Pose2D(0.0, 0.0, local.theta).transform_points(arm[None])[0]
        if np.hypot(*look) > ONE_WAY and look @ way > FROM_BEHIND * np.hypot(*look) * np.hypot(*way):
            total += table[field.codes[tuple(np.floor(cell[::-1]).astype(int))]] - outside
    return total
