"""Which scans count, and what is believed where the robot may be in one of several places or was doubted before."""

import dataclasses
import math

import numpy as np
import pytest
from synthetic_room import ORIGIN, room, scan_at
from test_localizer import START, drive, localizer

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.maps import OccupancyMap


def test_a_robot_that_stands_is_not_taken_to_move_by_the_noise_of_its_lidar_however_often_it_may_look():
    made, rng = localizer(update_min_d=0.0, update_min_a=0.0), np.random.default_rng(1)
    told = [made.process(IDENTITY, scan_at(room(), START, rng), IDENTITY) is not None for _ in range(10)]
    assert told == [True] + [False] * 9


def test_a_robot_that_has_not_turned_far_is_not_taken_to_be_carried_though_it_sees_something_else():
    made, turned = localizer(update_min_a=0.5), Pose2D(0.0, 0.0, 0.45)
    assert made.process(IDENTITY, scan_at(room(), START), IDENTITY) is not None
    assert made.process(turned, scan_at(room(), START.compose(turned)), IDENTITY) is None


def test_a_robot_that_something_is_put_over_is_not_taken_to_be_carried():
    """A few beams come back from it, and the others from nothing."""
    made, scan = localizer(), scan_at(room(), START)
    assert made.process(IDENTITY, scan, IDENTITY) is not None
    covered = np.where(np.arange(len(scan.ranges)) < 20, 0.3, math.inf)
    assert made.process(IDENTITY, dataclasses.replace(scan, ranges=covered), IDENTITY) is None


def test_a_robot_that_turns_a_little_past_where_headings_begin_anew_has_not_turned_far():
    made, scan = localizer(robust=False, update_min_a=0.2), scan_at(room(), START)
    assert made.process(Pose2D(0.0, 0.0, 3.1), scan, IDENTITY) is not None
    assert made.process(Pose2D(0.0, 0.0, -3.1), scan, IDENTITY) is None


@pytest.mark.parametrize("begin", [
    lambda made: made.set_initial_pose(START, np.diag([0.02, 0.02, 0.01])),
    lambda made: made.set_map(OccupancyMap(np.roll(room().data, 1, axis=0), 0.05, ORIGIN))])
def test_one_that_was_doubted_is_not_for_that_looked_for_all_over_another_map_or_after_a_start(begin):
    made = localizer(robust=False, resample_interval=3, recovery_alpha_slow=0.001, recovery_alpha_fast=0.5)
    drive(made, room(), updates=3)
    drive(made, room(), updates=1, start=Pose2D(-1.5, 2.5, 2.0))  # two later particles would be drawn anywhere
    assert made._averages.random_share() > 0.3
    begin(made)
    assert made._averages.random_share() == 0.0


def in_one_of_two_rooms():
    """Return the filter of a robot that may be in either of two rooms alike, and its estimate."""
    one = room().data
    twins = OccupancyMap(np.hstack((one, one)), 0.05, ORIGIN)
    made = Localizer(LocalizerParameters(), twins, np.random.default_rng(1))
    made.globalize()
    return made, made.process(IDENTITY, scan_at(twins, START, np.random.default_rng(2)), IDENTITY)


def test_a_robot_that_may_be_in_two_rooms_alike_is_as_unsure_as_that_is():
    made, estimate = in_one_of_two_rooms()
    poses, shares = zip(*made.hypotheses())
    places = np.array([pose.x for pose in poses])
    expected = np.average((places - np.average(places, weights=shares)) ** 2, weights=shares)
    assert sum(shares) == pytest.approx(1.0) and 0.2 < shares[0] < 0.8 and list(shares) == sorted(shares, reverse=True)
    assert estimate.covariance[0, 0] == pytest.approx(expected, rel=0.02) and expected > 10.0
    assert estimate.weight <= max(shares) + 1e-9


def blank():
    return dataclasses.replace(scan_at(room(), START), ranges=np.full(180, math.inf))


def test_a_place_where_the_robot_may_be_as_well_is_less_sure_after_a_way_on_which_nothing_is_seen():
    made, _ = in_one_of_two_rooms()
    before = made._tracker.hypotheses.rivals[0].belief.covariance.copy()
    made.process(Pose2D(1.0, 0.0, 0.5), blank(), IDENTITY)
    assert (np.diag(made._tracker.hypotheses.rivals[0].belief.covariance) > np.diag(before) + 1e-3).all()


def test_a_place_that_was_not_followed_for_a_while_does_not_come_back_with_the_robust_form():
    made, _ = in_one_of_two_rooms()
    assert len(made.hypotheses()) > 1
    for robust in (False, True):
        made.reconfigure(made.parameters.replace(robust=robust))
        made.process(Pose2D(1.0, 0.0, 0.0), blank(), IDENTITY)
    assert len(made.hypotheses()) == 1


def test_a_robot_that_turns_on_the_spot_is_less_sure_of_its_place_by_where_its_lidar_may_sit():
    """Odometry tells of no way, however far the lidar moves that sits 0.1 m from where tf has it."""
    alphas = {f"odom_alpha{index}": 0.0 for index in range(1, 6)}
    made = localizer(robust_odom_error=1e-3, resample_interval=100, **alphas)
    made.set_initial_pose(START, np.diag([1e-4, 1e-4, 1e-4]))
    made.process(IDENTITY, scan_at(room(), START), IDENTITY)
    before = made.poses[:, :2].std(axis=0)
    made.process(Pose2D(0.0, 0.0, 3.0), blank(), IDENTITY)
    assert (before < 0.05).all() and (made.poses[:, :2].std(axis=0) > 0.15).all()


@pytest.mark.parametrize("nothing", [0.0, 9.0])
def test_what_comes_into_sight_of_a_robot_that_stands_does_not_move_it(nothing):
    """Most beams met nothing before, which its lidar writes as a number."""
    made, scan = localizer(), dataclasses.replace(scan_at(room(), START), range_max=3.5)
    lost = np.arange(len(scan.ranges)) % 10 < 7
    assert made.process(IDENTITY, dataclasses.replace(scan, ranges=np.where(lost, nothing, scan.ranges)), IDENTITY)
    assert made.process(IDENTITY, scan, IDENTITY) is None


def test_one_that_is_doubted_on_a_map_without_a_free_cell_is_looked_for_nowhere_else():
    walls = OccupancyMap(np.full((40, 40), 100, dtype=np.int8), 0.05, ORIGIN)
    values = dict(robust=False, resample_interval=1, recovery_alpha_slow=0.001, recovery_alpha_fast=0.5)
    made = Localizer(LocalizerParameters(**values), walls, np.random.default_rng(1))
    for log_average in (50.0, -50.0):
        made._averages.update(log_average, 0.001, 0.5)
    assert made._averages.random_share() > 0.3
    assert made.process(IDENTITY, scan_at(room(), START), IDENTITY).pose.is_finite()
