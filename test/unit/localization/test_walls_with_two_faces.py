"""Walls as buildings have them: a face on either side, and a lidar that sees one of the two."""

import math

import numpy as np
import pytest
from synthetic_room import scan_at

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.distance_field import LOOK_BITS, DistanceField, is_free
from mbf_relay.localization.face_kernels import (
    FROM_BEHIND,
    LOOKS,
    NEAR,
    ONE_WAY,
    THIN,
    credit_from_behind,
    look_around,
)
from mbf_relay.localization.gaussians import PoseGaussian
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters
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
    modes = likelihood.modes(np.array([aside, PLACE], dtype=float), PoseGaussian(aside, np.eye(3)), ends)
    assert modes.poses[np.argmax(modes.log_masses)] == pytest.approx(PLACE, abs=0.03)


def test_a_thick_wall_is_not_believed_to_be_passed_by_and_by():
    """Beside the barriers of a race track the belief was drawn through them, 0.6 m aside, in two drives of eight."""
    data = np.zeros((200, 200), dtype=np.int8)
    data[:, 120:132] = -1
    data[:, 120] = data[:, 131] = 100
    data[60:62, 60:62] = 100
    likelihood = ScanLikelihood(DistanceField(OccupancyMap(data, 0.05, IDENTITY), 2.0), 0.2)
    ends = np.column_stack((np.full(60, 1.0), np.linspace(-2.0, 2.0, 60)))
    aside = np.column_stack((np.full(300, 5.55), np.linspace(2.5, 7.5, 300), np.zeros(300)))
    right = aside - (0.55, 0.0, 0.0)
    assert (likelihood.log(right, ends) > likelihood.log(aside, ends) + 20.0).all()
    assert (likelihood.log(right[:9], ends) > likelihood.log(aside[:9], ends) + 20.0).all()


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("thin_too", [False, True])
def test_what_is_seen_from_behind_is_what_plain_numpy_says(seed, thin_too):
    rng = np.random.default_rng(seed)
    data = rng.choice(np.array([0, 0, 0, 100, -1], dtype=np.int8), (30, 40))
    data[8:20, 10:25] = -1
    data[8, 10:25] = data[19, 10:25] = 100
    field = DistanceField(OccupancyMap(data, 0.1, Pose2D(0.3, -0.2, 0.4)), 2.0)
    poses, ends = field.random_free_poses(5, rng), rng.uniform(-2.0, 2.0, (60, 2))
    table, outside = rng.uniform(-2.0, 0.0, 1 << 16).astype(np.float32), -2.5
    sums = np.empty(len(poses))
    credit_from_behind(poses, ends, field.codes, LOOK_BITS, thin_too, field.frame, table, outside, sums)
    assert sums == pytest.approx([plain(field, pose, ends, table, outside, thin_too) for pose in poses], abs=1e-4)
    assert (sums != 0.0).any()


def plain(field, pose, ends, table, outside, thin_too):
    looks, local, total = plain_looks(field), Pose2D(*pose).relative_to(field.origin), 0.0
    height, width = looks.shape
    for arm in ends:
        x, y = np.floor(np.array(local.transform_points(arm[None])[0]) / field.resolution).astype(int)
        if not (0 <= x < width and 0 <= y < height) or looks[y, x] == 0 or (looks[y, x] & THIN and not thin_too):
            continue
        angle = ((looks[y, x] & LOOKS) - 0.5) * math.tau / LOOKS - math.pi
        way = Pose2D(0.0, 0.0, local.theta).transform_points(arm[None])[0]
        if way @ (math.cos(angle), math.sin(angle)) > FROM_BEHIND * np.hypot(*way):
            total += table[field.codes[y, x]] - outside
    return total


def plain_looks(field):
    """Return how the face nearest to each cell looks."""
    faces, free = field.face_distances[field.codes] == 0.0, is_free(field.occupancy.data)
    height, width = faces.shape
    looks, nearest = np.zeros(faces.shape, dtype=int), np.full(faces.shape, NEAR * NEAR + 1)
    for y, x in np.argwhere(faces):
        to, look = np.zeros(2), 0
        for v, u in np.argwhere(free[max(y - 1, 0):y + 2, max(x - 1, 0):x + 2]):
            way = np.array([u + max(x - 1, 0) - x, v + max(y - 1, 0) - y])
            to += way / np.hypot(*way)
        if np.hypot(*to) > ONE_WAY:
            look = 1 + int((math.atan2(to[1], to[0]) + math.pi) / math.tau * LOOKS) % LOOKS
            behind = np.array([x, y]) - np.arange(1, round(0.3 / field.resolution) + 1)[:, None] * to / np.hypot(*to)
            behind = [(u, v) for u, v in np.rint(behind).astype(int) if 0 <= u < width and 0 <= v < height]
            look += THIN if any(free[v, u] for u, v in behind) else 0
        for v in range(max(y - NEAR, 0), min(y + NEAR + 1, height)):
            for u in range(max(x - NEAR, 0), min(x + NEAR + 1, width)):
                far = (u - x) ** 2 + (v - y) ** 2
                if far <= NEAR * NEAR and far < nearest[v, u]:
                    nearest[v, u], looks[v, u] = far, look
    return looks


def test_the_looks_are_in_the_codes():
    occupancy = house()
    field = DistanceField(occupancy, 2.0)
    looks = (field.codes >> LOOK_BITS) & (LOOKS + THIN)
    assert (looks == plain_looks(field)).all()
    assert looks[49, 30] == looks[50, 30] != looks[52, 30] == looks[53, 30]  # the two faces of a wall, and what is near
    assert looks[50, 30] & THIN and not looks[95, 75] and not looks[200, 200]
    bare = np.zeros((5, 5), dtype=np.uint8)
    look_around(bare, bare, 6, bare, bare + np.uint8(255))
    assert not bare.any()
