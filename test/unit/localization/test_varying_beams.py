"""Lidars whose scans vary: by a few beams from turn to turn, as an RPLidar's or an LD19's, or down to none at all."""

import numpy as np
from synthetic_room import room, scan_at

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.scan import LaserScan

START = Pose2D(1.5, 0.5, 0.3)
STEP = Pose2D(0.3, 0.0, 0.5)


def turn_of(truth, rng):
    """Return a scan of 160 to 180 beams."""
    return scan_at(room(), truth, rng, beams=int(rng.integers(160, 181)))


def driven(rng):
    """Return a localizer that knows where it is after a drive, the true pose, and that in odometry's frame."""
    parameters = LocalizerParameters(min_particles=500, max_particles=2000, resample_interval=1)
    made, truth, odom = Localizer(parameters, room(), np.random.default_rng(1)), START, Pose2D(5.0, 5.0, 1.0)
    made.set_initial_pose(START, np.diag([0.02, 0.02, 0.01]))
    for _ in range(18):
        truth, odom = truth.compose(STEP), odom.compose(STEP)
        made.process(odom, turn_of(truth, rng), IDENTITY)
    return made, truth, odom


def test_a_robot_whose_odometry_stands_still_while_it_drives_does_not_claim_to_be_where_it_was():
    """Two scans with as many beams hardly ever followed each other, and others were not compared at all."""
    rng = np.random.default_rng(3)
    made, truth, odom = driven(rng)
    known = made.reliability()
    for _ in range(60):
        truth = truth.compose(Pose2D(0.03, 0.0, 0.05))
        made.process(odom, turn_of(truth, rng), IDENTITY)
    assert made.reliability() < 0.1 < 0.8 < known


def test_a_robot_that_stands_is_not_taken_to_move():
    rng = np.random.default_rng(3)
    made, truth, odom = driven(rng)
    assert not any(made.process(odom, turn_of(truth, rng), IDENTITY) for _ in range(40))


def test_a_robot_that_stands_does_not_fill_its_memory_with_numpys_masked_arrays(monkeypatch):
    """NumPy's median reads them: a MiB of amcl, from the second scan on."""
    rng = np.random.default_rng(3)
    made, truth, odom = driven(rng)
    monkeypatch.delattr(np, "ma")
    assert not any(made.process(odom, turn_of(truth, rng), IDENTITY) for _ in range(2))


def test_a_lidar_that_sees_nothing_does_not_keep_another_from_finding_the_robot():
    """A camera before which nothing stands: its cloud has no point, and each time it took the way for itself."""
    empty = LaserScan(np.full(90, np.nan), -0.5, 1.0 / 90.0, 0.1, 6.0, 0.0, "camera")
    made, rng = Localizer(LocalizerParameters(), room(), np.random.default_rng(1)), np.random.default_rng(3)
    truth, odom = START, Pose2D(5.0, 5.0, 1.0)
    made.set_initial_pose(Pose2D(3.0, 2.5, -2.0), np.diag([0.02, 0.02, 0.01]))
    for _ in range(40):
        truth, odom = truth.compose(STEP), odom.compose(STEP)
        made.process(odom, empty, IDENTITY)
        estimate = made.process(odom, turn_of(truth, rng), IDENTITY)
    assert estimate.pose.distance_to(truth) < 0.1
    assert made.reliability() > 0.8
