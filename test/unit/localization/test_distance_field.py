"""What localization knows of a map: the share of a scan that it explains."""

import numpy as np
import pytest

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.distance_field import DistanceField
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
