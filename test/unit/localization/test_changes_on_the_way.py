"""What becomes of what is believed and known where parameters, map or frames change while the robot drives."""

import functools

import numpy as np
import pytest
from synthetic_room import ORIGIN, room, scan_at
from test_localizer import START, drive, localizer

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.odometry_watch import OdometryWatch
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.maps import OccupancyMap


@pytest.mark.parametrize("robust", [False, True])
def test_a_robot_whose_odometry_comes_in_another_frame_from_now_on_stays_where_it_is(robust):
    made = localizer(robust=robust)
    truth, _, _ = drive(made, room())
    made.change_odometry()
    assert made.map_from_odom is None
    odom = Pose2D(-40.0, 7.0, 2.0)
    estimate = made.process(odom, scan_at(room(), truth), IDENTITY)
    assert estimate.pose.distance_to(truth) < (0.03 if robust else 0.12)
    assert made.map_from_odom.compose(odom).distance_to(estimate.pose) < 1e-9


@pytest.mark.parametrize("robust", [False, True])
def test_a_robot_whose_odometry_begins_anew_stays_where_it_is(robust):
    """A base's driver that was restarted sent it 8 m off, where no scan fits, and it was sure of that for metres."""
    made, truth, odom = localizer(robust=robust), START, Pose2D(5.0, 5.0, 1.0)
    for index in range(30):
        step = Pose2D(0.1, 0.0, 0.2) if index != 15 else IDENTITY
        truth, odom = truth.compose(step), odom.compose(step) if index != 15 else IDENTITY
        made.process(odom, scan_at(room(), truth, stamp=0.2 * index), IDENTITY)
        assert made.map_from_odom.compose(odom).distance_to(truth) < (0.15 if robust else 0.3)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("came, seconds", [
    (Pose2D(1.5, 0.0, 0.0), 0.2), (Pose2D(0.0, 2.0, 1.0), 0.2), (Pose2D(1.0, 0.0, 0.0), 0.1),
    (Pose2D(0.0, 0.3, 2.0), 0.2), (Pose2D(0.0, 0.0, 1.2), 0.1)])
def test_a_robot_that_has_not_come_far_when_its_odometry_begins_anew_stays_where_it_is(robust, came, seconds):
    """It was sent where that led, up to 2.5 m off: for two seconds, and by amcl's own form for as long as it drove."""
    made, truth, step = localizer(robust=robust), START, Pose2D(0.1, 0.0, 0.2)
    odom = came.compose(functools.reduce(Pose2D.compose, [step] * 15).inverse())
    for index in range(30):
        truth, odom = (truth.compose(step), odom.compose(step)) if index != 15 else (truth, IDENTITY)
        made.process(odom, scan_at(room(), truth, stamp=seconds * index), IDENTITY)
        assert made.map_from_odom.compose(odom).distance_to(truth) < (0.15 if robust else 0.3)
    assert made.odometry.jumps == 1


@pytest.mark.parametrize("robust", [False, True])
def test_a_robot_that_turns_while_its_odometry_jumps_aside_and_back_stays_where_it_is(robust):
    """Its scan did not fit with the heading of before: it was taken to have gone where odometry led, out of the map."""
    made, truth, odom = localizer(robust=robust), START, IDENTITY
    for index in range(30):
        step = Pose2D(0.1, 0.0, 0.2) if index not in (10, 20) else Pose2D(0.0, 0.0, 0.45)
        truth, odom = truth.compose(step), odom.compose(step)
        told = odom._replace(x=odom.x + 2.0) if 10 <= index < 20 else odom
        made.process(told, scan_at(room(), truth, stamp=0.2 * index), IDENTITY)
        assert made.map_from_odom.compose(told).distance_to(truth) < (0.15 if robust else 0.3)
    assert made.odometry.jumps == 2


def test_a_robot_that_starts_and_stops_as_hard_as_one_can_is_where_it_drove():
    """Odometry that leads beside the walls for a moment, as wheels that spin do, is not one that began anew."""
    made, truth, odom = localizer(), START, IDENTITY
    for index, way in enumerate([0.02, 0.3, 0.5, 0.5, 0.05, -0.3, -0.5, -0.02, 0.0]):
        truth, odom = truth.compose(Pose2D(0.7 * way, 0.0, 0.3)), odom.compose(Pose2D(way, 0.0, 0.3))
        made.process(odom, scan_at(room(), truth, stamp=0.2 * index), IDENTITY)
    assert made.odometry.jumps == 0


@pytest.mark.parametrize("steps, jumps", [
    ([(0.0, 0.5), (2.0, 0.5)], 0),  # it speeds up between scans that are far apart
    ([(1.5, 0.2)], 0),  # nobody knows how fast it was when localization began
    ([(5.0, 0.2), (1.5, 0.2)], 1),  # nor when its odometry did
    ([(9.0, 1.0), (12.0, 1.0)], 1),  # no robot is as fast
])
def test_a_fast_robot_in_a_corridor_is_not_held_back_where_it_was(steps, jumps):
    """Each place looks much like the one before, and the scan may happen to fit that a little better."""
    watch, odom, now = OdometryWatch(), IDENTITY, 1.0
    watch.moved_frame(odom, now, IDENTITY, lambda _: 1.0)
    for way, seconds in steps:
        before, odom, now = odom, odom.compose(Pose2D(way, 0.0, 0.0)), now + seconds
        watch.moved_frame(odom, now, IDENTITY, lambda pose, before=before: 0.9 if pose == before else 0.8)
    assert watch.jumps == jumps


def test_a_robot_that_is_put_elsewhere_in_a_simulation_and_its_odometry_with_it_is_there():
    made, there = localizer(), Pose2D(-2.0, 2.0, 1.0)
    truth, odom, _ = drive(made, room())
    made.process(odom, scan_at(room(), truth, stamp=7.0), IDENTITY)
    odom = odom.compose(there.relative_to(truth))
    estimate = made.process(odom, scan_at(room(), there, stamp=7.2), IDENTITY)
    assert estimate.pose.distance_to(there) < 0.1


@pytest.mark.parametrize("change", ["parameter", "map"])
def test_a_robot_that_may_be_anywhere_still_may_when_something_changes_before_it_looks(change):
    """It was looked for by its particles alone, and found in one of the places that look alike."""
    found = []
    for changes in (False, True):
        made = Localizer(LocalizerParameters(max_particles=2000), room(), np.random.default_rng(1))
        made.globalize()
        if changes and change == "parameter":
            made.reconfigure(made.parameters.replace(update_min_a=0.3))
        elif changes:
            made.set_map(OccupancyMap(np.zeros((5, 5), np.int8), 0.05, ORIGIN))
            made.set_map(room())
        made.process(IDENTITY, scan_at(room(), START, np.random.default_rng(9)), IDENTITY)
        found.append(made.hypotheses())
    assert found[0] == found[1] and len(found[0]) > 1


def test_a_robot_goes_on_doubting_where_it_is_when_a_parameter_changes():
    made = Localizer(LocalizerParameters(max_particles=2000), room(), np.random.default_rng(1))
    made.globalize()
    drive(made, room(), updates=3)
    before, sure, blocks = made.hypotheses(), made.reliability(), made.changed_blocks().data
    assert 0.5 < sure < 1.0 and (blocks >= 0).any()
    made.reconfigure(made.parameters.replace(update_min_a=0.3, laser_likelihood_max_dist=1.0))
    assert made.hypotheses() == before and made.reliability() == sure
    assert (made.changed_blocks().data == blocks).all()


def test_a_map_that_is_sent_again_and_again_changes_nothing_of_what_is_believed():
    """A robot between two rooms that look alike had the wrong one for sure: the other was forgotten with each map."""
    made = Localizer(LocalizerParameters(max_particles=2000), room(), np.random.default_rng(1))
    made.globalize()
    drive(made, room(), updates=3)
    before, sure, blocks = made.hypotheses(), made.reliability(), made.changed_blocks().data
    made.set_map(room())
    assert len(before) > 1 and made.hypotheses() == before and made.reliability() == sure
    assert (made.changed_blocks().data == blocks).all()
    for other in (room(Pose2D(-3.0, -2.0, 0.1)), OccupancyMap(room().data[::-1].copy(), 0.05, ORIGIN)):
        made.set_map(other)
        assert len(made.hypotheses()) == 1 and made.field.occupancy is other


def test_an_arm_that_was_learnt_is_known_on_the_next_map_and_with_other_parameters():
    made = localizer()
    drive(made, room())
    arm, surely = made._tracker.lever_arm.arm, made._tracker.lever_arm.covariance
    made.reconfigure(made.parameters.replace(update_min_a=0.3))
    made.set_map(OccupancyMap(room().data[::-1].copy(), 0.05, ORIGIN))
    assert (made._tracker.lever_arm.arm == arm).all() and (made._tracker.lever_arm.covariance == surely).all()


@pytest.mark.parametrize("heading", [0.0, 1.6, 3.1])
def test_a_robot_that_turns_while_its_map_grows_learns_where_its_lidar_is(heading):
    """Each new map had it take the next turn for one that began along the map's x axis: facing back it learnt -0.4 m.
    """
    aside, occupancy, rng = Pose2D(0.2, 0.0, 0.0), room(), np.random.default_rng(4)
    base, odom = Pose2D(-1.0, 1.5, heading), IDENTITY
    made = localizer(start=base.compose(aside))
    for index in range(16):
        turn = Pose2D(0.0, 0.0, 0.7 if index % 2 else -0.7)
        base, odom = base.compose(turn), odom.compose(turn)
        data = occupancy.data.copy()
        data[60, 100 + index] = 100
        made.set_map(OccupancyMap(data, occupancy.resolution, occupancy.origin))
        made.process(odom, scan_at(occupancy, base.compose(aside), rng, stamp=0.5 * index), IDENTITY)
    assert made._tracker.lever_arm.arm == pytest.approx((0.2, 0.0), abs=0.06)


def test_a_robot_that_turns_before_it_sees_anything_does_not_learn_that_its_lidar_is_where_it_is_not():
    aside, rng = Pose2D(0.2, 0.0, 0.0), np.random.default_rng(4)
    base, odom = Pose2D(-1.0, 1.5, 3.1), IDENTITY
    made = localizer(start=base.compose(aside))
    for index in range(3):
        seen = scan_at(room(), base.compose(aside), rng, stamp=0.5 * index)
        seen.ranges[:] = seen.ranges if index == 2 else np.inf
        made.process(odom, seen, IDENTITY)
        base, odom = base.compose(Pose2D(0.0, 0.0, 0.7)), odom.compose(Pose2D(0.0, 0.0, 0.7))
    assert made._tracker.lever_arm.arm == pytest.approx((0.2, 0.0), abs=0.15)
