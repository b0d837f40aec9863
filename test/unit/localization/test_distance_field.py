"""What localization knows of a map: the share of a scan that it explains."""

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import DistanceField, distances_to
from mbf_relay.maps import OccupancyMap

WALL_AT = 3.0


def field(origin=Pose2D(0.0, 0.0, 0.0)):
    """Five metres square with a wall across, three metres from the origin along the map's own x."""
    data = np.zeros((100, 100), dtype=np.int8)
    data[:, 60] = 100
    return DistanceField(OccupancyMap(data, 0.05, origin), 2.0)


def ends(distance):
    """What a robot sees of a wall straight ahead."""
    return np.column_stack((np.full(21, distance), np.linspace(-1.0, 1.0, 21)))


def test_a_scan_of_the_wall_fits_from_where_it_was_taken_and_not_from_elsewhere():
    pose = Pose2D(1.0, 2.5, 0.0)
    assert field().share_on_map(pose, ends(WALL_AT - pose.x + 0.02)) == 1.0
    assert field().share_on_map(Pose2D(1.5, 2.5, 0.0), ends(WALL_AT - pose.x)) == 0.0
    assert field().share_on_map(Pose2D(1.0, 2.5, 0.6), ends(WALL_AT - pose.x)) < 0.3


def test_what_the_map_lacks_counts_against_it():
    pose = Pose2D(1.0, 2.5, 0.0)
    seen = np.concatenate((ends(WALL_AT - pose.x + 0.02), ends(0.5), np.full((21, 2), 100.0)))
    assert field().share_on_map(pose, seen) == pytest.approx(1.0 / 3.0)


def test_the_map_may_be_turned_and_moved():
    origin = Pose2D(-7.0, 4.0, 2.1)
    pose = origin.compose(Pose2D(1.0, 2.5, 0.0))
    assert field(origin).share_on_map(pose, ends(WALL_AT - 1.0 + 0.02)) == 1.0


def test_a_scan_that_saw_nothing_says_nothing():
    assert field().share_on_map(Pose2D(1.0, 2.5, 0.0), np.empty((0, 2))) is None


@pytest.mark.parametrize("resolution, error", [(0.05, 1e-6), (0.004, 4e-5)])
def test_a_large_map_takes_no_more_than_twice_its_own_memory_and_bands_leave_no_seam(resolution, error):
    rng = np.random.default_rng(1)
    data = np.where(rng.random((700, 90)) < 0.002, 100, 0).astype(np.int8)
    data[250:262, 30:50] = 100  # thick, and across the border of two bands
    made = DistanceField(OccupancyMap(data, resolution, Pose2D(0.0, 0.0, 0.0)), 2.0)
    assert made.codes.nbytes == 2 * data.nbytes
    assert made.distances == pytest.approx(distances_to(data == 100, resolution, 2.0), abs=error)
    faces = data == 100
    faces[251:261, 31:49] = False
    assert made.face_distances[made.codes] == pytest.approx(distances_to(faces, resolution, 2.0), abs=error)


def test_a_lost_robot_may_be_in_every_free_cell_and_in_no_other():
    data = np.array([[0, 100, -1, 0], [100, 100, 100, 100], [-1, 0, 50, 0]], dtype=np.int8)
    made = DistanceField(OccupancyMap(data, 1.0, Pose2D(0.0, 0.0, 0.0)), 2.0)
    cells = np.floor(made.random_free_poses(400, np.random.default_rng(1))[:, :2]).astype(int)
    assert set(map(tuple, cells[:, ::-1])) == set(map(tuple, np.argwhere(data == 0)))
