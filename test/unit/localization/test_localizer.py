import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from synthetic_room import ORIGIN, room, scan_at

from mbf_relay.geometry import IDENTITY, Pose2D, angle_between
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.maps import OccupancyMap
from mbf_relay.scan import LaserScan

START = Pose2D(1.5, 0.5, 0.3)
NARROW = np.diag([0.02, 0.02, 0.01])
MODELS = ["beam", "likelihood_field", "likelihood_field_prob"]


def localizer(occupancy=None, seed=1, start=START, **values):
    values = {"min_particles": 500, "max_particles": 2000, "resample_interval": 1, "laser_max_beams": 60, **values}
    made = Localizer(LocalizerParameters(**values), occupancy or room(), np.random.default_rng(seed))
    made.set_initial_pose(start, NARROW)
    return made


def drive(made, occupancy, updates=12, start=START, rng=None):
    """Drive a small circle; return the true pose at its end and the estimates."""
    truth, odom, estimates = start, Pose2D(5.0, 5.0, 1.0), []
    rng = rng or np.random.default_rng(7)
    for _ in range(updates):
        step = Pose2D(0.3, 0.0, 0.5)
        truth, odom = truth.compose(step), odom.compose(step)
        estimates.append(made.process(odom, scan_at(occupancy, truth, rng), IDENTITY))
    return truth, odom, estimates


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("model", MODELS)
def test_every_model_tracks(model, robust):
    made = localizer(laser_model_type=model, robust=robust)
    truth, odom, estimates = drive(made, room())
    assert estimates[-1].pose.distance_to(truth) < (0.03 if robust else 0.12)
    assert abs(angle_between(estimates[-1].pose.theta, truth.theta)) < 0.06
    believed = made.map_from_odom.compose(odom)
    assert believed.distance_to(estimates[-1].pose) < 1e-9


@pytest.mark.parametrize("kind", ["diff", "omni", "diff-corrected", "omni-corrected"])
def test_every_odometry_model_tracks(kind):
    truth, _, estimates = drive(localizer(odom_model_type=kind), room())
    assert estimates[-1].pose.distance_to(truth) < 0.05


@pytest.mark.parametrize("robust", [False, True])
def test_weights_sum_to_one_and_covariance_is_a_covariance(robust):
    made = localizer(resample_interval=3, robust=robust)
    for estimate in drive(made, room(), updates=4)[2]:
        assert made.weights.sum() == pytest.approx(1.0)
        assert (np.linalg.eigvalsh(estimate.covariance) >= -1e-12).all()
        assert 0.0 < estimate.weight <= 1.0


@pytest.mark.parametrize("robust", [False, True])
def test_equal_seeds_give_equal_results(robust):
    one, other = (drive(localizer(seed=4, robust=robust), room())[2] for _ in range(2))
    assert [e.pose for e in one] == [e.pose for e in other]


@settings(max_examples=5)
@given(st.floats(-50.0, 50.0), st.floats(-50.0, 50.0), st.floats(-3.0, 3.0))
def test_moving_world_and_map_together_moves_the_estimate_along(x, y, theta):
    move = Pose2D(x, y, theta)
    plain = drive(localizer(), room(), updates=4)[2][-1].pose
    moved_map, start = room(move.compose(ORIGIN)), move.compose(START)
    moved = drive(localizer(moved_map, start=start), moved_map, updates=4, start=start)[2][-1].pose
    assert moved.distance_to(move.compose(plain)) < 0.03
    assert abs(angle_between(moved.theta, move.compose(plain).theta)) < 0.03


def test_updates_wait_for_motion():
    made, occupancy = localizer(update_min_d=0.2, update_min_a=0.3), room()
    odom, scan = Pose2D(0.0, 0.0, 0.0), scan_at(occupancy, START)
    assert made.process(odom, scan, IDENTITY) is not None  # the first one always counts
    assert made.process(odom, scan, IDENTITY) is None
    assert made.process(Pose2D(0.19, 0.0, 0.29), scan, IDENTITY) is None
    assert made.process(Pose2D(0.0, 0.0, 0.31), scan, IDENTITY) is not None
    assert made.process(Pose2D(0.21, 0.0, 0.31), scan, IDENTITY) is not None
    assert made.process(Pose2D(0.21, 0.0, 0.31), scan, IDENTITY) is None
    made.request_update()
    assert made.process(Pose2D(0.21, 0.0, 0.31), scan, IDENTITY) is not None
    assert made.process(Pose2D(0.21, 0.0, 0.31), scan, IDENTITY) is None


def test_each_lidar_gives_one_scan_to_an_update():
    made, occupancy = localizer(), room()
    front = scan_at(occupancy, START, frame="front")
    rear = scan_at(occupancy, START, frame="rear")
    assert made.process(Pose2D(0.0, 0.0, 0.0), front, IDENTITY) is not None
    assert made.process(Pose2D(0.0, 0.0, 0.0), rear, IDENTITY) is not None
    assert made.process(Pose2D(0.05, 0.0, 0.0), front, IDENTITY) is None
    assert made.process(Pose2D(0.3, 0.0, 0.0), rear, IDENTITY) is not None
    assert made.process(Pose2D(0.3, 0.0, 0.0), rear, IDENTITY) is None
    assert made.process(Pose2D(0.3, 0.0, 0.0), front, IDENTITY) is not None


@pytest.mark.parametrize("resample_interval", [1, 2])
def test_a_robot_is_as_sure_of_its_place_however_often_it_looks(resample_interval):
    """In a bare corridor the way along is odometry's; across, scans on the way say what the last one said."""
    data = np.zeros((60, 400), dtype=np.int8)
    data[8:10] = data[50:52] = 100
    corridor, spreads = OccupancyMap(data, 0.05, Pose2D(0.0, 0.0, 0.0)), []
    for steps in (5, 25, 125):
        made = localizer(corridor, start=Pose2D(8.0, 1.5, 0.0), update_min_d=0.0, resample_interval=resample_interval)
        for step in range(steps + 1):
            driven = 2.0 * step / steps
            scan = scan_at(corridor, Pose2D(8.0 + driven, 1.5, 0.0), np.random.default_rng(step))
            estimate = made.process(Pose2D(driven, 0.0, 0.0), scan, IDENTITY)
        spreads.append(np.sqrt(np.diag(estimate.covariance)))
    along, across, _ = np.array(spreads).T
    assert max(along) < 1.3 * min(along)
    assert max(across) < 2.0 * min(across)


def test_a_robot_that_looks_every_two_centimetres_is_as_near_as_one_that_looks_every_metre():
    """What odometry did since the last scan that was all news must not stay in the pose that is told."""
    fine, off = 0.02, {}
    for step, seed in itertools.product((0.02, 0.1, 1.0), (0, 1, 2)):
        made = localizer(seed=seed, update_min_d=0.0, update_min_a=0.0)
        rng, wheels = np.random.default_rng([seed, 1]), np.random.default_rng([seed, 2])
        truth, odom = START, IDENTITY
        for index in range(round(5.0 / step) + 1):
            estimate = made.process(odom, scan_at(room(), truth, rng), IDENTITY)
            if index and index % round(1.0 / step) == 0:
                turn = abs(angle_between(estimate.pose.theta, truth.theta))
                off.setdefault(step, []).append((estimate.pose.distance_to(truth), turn))
            for _ in range(round(step / fine)):
                noise = 0.07 * math.sqrt(fine) * wheels.standard_normal(2)
                truth = truth.compose(Pose2D(fine, 0.0, 1.6 * fine))
                odom = odom.compose(Pose2D(fine + noise[0], 0.0, 1.6 * fine + noise[1]))
    (seldom, seldom_turned), *often = (np.mean(off[step], axis=0) for step in (1.0, 0.1, 0.02))
    assert max(distance for distance, _ in often) < 1.5 * seldom + 0.003
    assert max(turn for _, turn in often) < 1.5 * seldom_turned + 0.0015


def test_a_wall_the_map_lacks_pulls_no_harder_on_a_robot_that_looks_more_often():
    whole = np.zeros((60, 400), dtype=np.int8)
    whole[8:10] = whole[50:52] = 100
    for column in (150, 190, 230, 270):
        whole[44:52, column:column + 8] = 100
    lacking = whole.copy()
    lacking[:, 180:260] = 0
    world, pulled = OccupancyMap(whole, 0.05, Pose2D(0.0, 0.0, 0.0)), {}
    for steps in (10, 200):
        made = localizer(
            OccupancyMap(lacking, 0.05, Pose2D(0.0, 0.0, 0.0)), start=Pose2D(9.0, 1.4, 0.0), update_min_d=0.0
        )
        for step in range(steps + 1):
            driven = 3.0 * step / steps
            truth = Pose2D(9.0 + driven, 1.4, 0.0)
            scan = scan_at(world, truth, np.random.default_rng(step), range_max=3.5)
            estimate = made.process(Pose2D(driven, 0.0, 0.0), scan, IDENTITY)
        pulled[steps] = estimate.pose.distance_to(truth)
    assert pulled[200] < max(0.3, 1.5 * pulled[10])


@pytest.mark.parametrize("robust", [False, True])
def test_how_a_scan_fits_and_how_many_particles_it_left_is_told(robust):
    told = {}
    for name, start in (("right", START), ("wrong", START.compose(Pose2D(0.6, 0.0, 0.0)))):
        made = localizer(start=START, robust=robust)
        assert made.log_likelihood is None
        made.process(IDENTITY, scan_at(room(), start), IDENTITY)
        told[name] = made.log_likelihood
        assert 1.0 <= made.effective_particles <= 2000.0
    assert told["right"] > told["wrong"] + 0.5


def test_resampling_keeps_its_interval_and_can_wait_for_need():
    made, occupancy = localizer(resample_interval=3, robust=False), room()
    drive(made, occupancy, updates=2)
    assert len(set(np.round(made.weights, 15))) > 1
    drive(made, occupancy, updates=1)
    assert made.weights == pytest.approx(1.0 / len(made.poses))
    choosy = localizer(selective_resampling=True, robust=False, laser_sigma_hit=5.0)
    drive(choosy, occupancy, updates=1)
    assert len(choosy.poses) == 2000  # weights hardly differ, so nothing was drawn


@pytest.mark.parametrize(
    "pose, covariance, complaint",
    [
        (Pose2D(math.nan, 0.0, 0.0), NARROW, "not finite"), (Pose2D(50.0, 0.0, 0.0), NARROW, "not on the map"),
        (START, NARROW * math.nan, "covariance"), (START, np.zeros((2, 2)), "covariance"),
        (Pose2D(0.0, math.inf, 0.0), NARROW, "not finite"),
        # of a robot so unsure the particles lay a hundred kilometres off the map, and no goal was driven to
        (START, np.diag([1e12, 1e12, 0.1]), "deviation of 1e.06 m"),
    ],
)
def test_bad_initial_poses_are_refused_and_harm_nothing(pose, covariance, complaint):
    made = localizer()
    drive(made, room(), updates=2)
    before = made.poses.copy()
    with pytest.raises(ValueError, match=complaint):
        made.set_initial_pose(pose, covariance)
    assert np.array_equal(made.poses, before)


@pytest.mark.parametrize("unsure", [1e6, 1e308])
def test_a_robot_that_may_head_anywhere_starts_however_large_that_is_written(unsure):
    """An initial_cov_aa of 1e308 left no particle with a heading that is a number, and the robot was nowhere."""
    made = localizer()
    made.set_initial_pose(START, np.diag([0.01, 0.01, unsure]))
    assert np.histogram(made.poses[:, 2], 4, (-math.pi, math.pi))[0].min() > 0.2 * len(made.poses)


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize(
    "ranges",
    [np.full(60, np.nan), np.full(60, np.inf), np.full(60, -1.0), np.zeros(60), np.array([]), np.full(7, 1.0)],
    ids=["nan", "inf", "negative", "zero", "empty", "other size"],
)
def test_bad_scans_leave_the_filter_sane(ranges, robust):
    made, occupancy = localizer(robust=robust), room()
    made.process(Pose2D(0.0, 0.0, 0.0), scan_at(occupancy, START), IDENTITY)
    try:
        made.process(Pose2D(0.3, 0.0, 0.0), LaserScan(ranges, 0.0, 0.1, 0.12, 6.0, 0.0), IDENTITY)
    except ValueError as error:
        assert str(error)
    assert np.isfinite(made.poses).all()
    assert made.weights.sum() == pytest.approx(1.0)
    truth = START.compose(Pose2D(0.6, 0.0, 0.0))
    estimate = made.process(Pose2D(0.6, 0.0, 0.0), scan_at(occupancy, truth), IDENTITY)
    assert estimate.pose.distance_to(truth) < 0.3


def test_odometry_that_is_no_number_is_refused():
    made = localizer()
    with pytest.raises(ValueError, match="odometry pose"):
        made.process(Pose2D(math.nan, 0.0, 0.0), scan_at(room(), START), IDENTITY)
    assert np.isfinite(made.poses).all()


def test_empty_maps_are_refused_and_the_old_one_stays():
    made = localizer()
    field = made.field
    for bad in (
        OccupancyMap(np.zeros((0, 0), dtype=np.int8), 0.05, IDENTITY),
        OccupancyMap(np.zeros((3, 3), dtype=np.int8), 0.0, IDENTITY),
        OccupancyMap(np.zeros((3, 3), dtype=np.int8), 0.05, Pose2D(math.nan, 0.0, 0.0)),
    ):
        with pytest.raises(ValueError, match="map"):
            made.set_map(bad)
    assert made.field is field
    drive(made, room(), updates=2)


def test_a_robot_that_stands_finds_itself_on_a_map_whose_frame_has_moved_when_updates_are_asked_for():
    made = localizer()
    truth, odom, _ = drive(made, room())
    shift = Pose2D(0.3, -0.2, 0.1)
    made.set_map(room(shift.compose(ORIGIN)))
    for _ in range(8):
        made.request_update()
        estimate = made.process(odom, scan_at(room(), truth), IDENTITY)
    assert estimate.pose.distance_to(shift.compose(truth)) < 0.05


def test_a_robot_whose_odometry_stands_still_while_it_drives_does_not_claim_to_be_where_it_was():
    made, occupancy, rng = localizer(), room(), np.random.default_rng(3)
    truth, odom, _ = drive(made, occupancy, updates=18)
    known = made.reliability()
    truth, odom = truth.compose(Pose2D(0.1, 0.0, 0.0)), odom.compose(Pose2D(0.1, 0.0, 0.0))
    for _ in range(60):
        truth = truth.compose(Pose2D(0.03, 0.0, 0.05))
        made.process(odom, scan_at(occupancy, truth, rng), IDENTITY)
    assert made.reliability() < 0.1 < 0.8 < known
    for _ in range(22):
        step = Pose2D(0.3, 0.0, 0.5)
        truth, odom = truth.compose(step), odom.compose(step)
        estimate = made.process(odom, scan_at(occupancy, truth, rng), IDENTITY)
    assert estimate.pose.distance_to(truth) < 0.1 and made.reliability() > 0.5


def test_people_all_round_a_robot_that_stands_move_it_nowhere():
    made, occupancy, rng = localizer(), room(), np.random.default_rng(3)
    truth, odom, _ = drive(made, occupancy)
    known = made.reliability()
    for distance in np.linspace(0.6, 0.9, 20):
        scan = scan_at(occupancy, truth, rng)
        people = np.arange(len(scan.ranges)) % 12 < 7
        shadowed = np.where(people, np.minimum(scan.ranges, distance), scan.ranges)
        made.process(odom, dataclasses.replace(scan, ranges=shadowed), IDENTITY)
    assert made.map_from_odom.compose(odom).distance_to(truth) < 0.05
    assert made.reliability() > 0.9 * known


@pytest.mark.parametrize(("nothing", "limits"), [
    (0.0, {}), (3.5, {}), (9.0, {}), (0.15, {"laser_min_range": 0.2}), (3.45, {"laser_max_range": 3.4}),
])
def test_a_robot_that_stands_is_not_taken_to_move_where_its_lidar_flickers(nothing, limits):
    """Many lidars send 0, or a range beyond their longest, for a beam that came back from nothing.

    Others send what only their users know to be nothing.
    """
    made, occupancy, rng = localizer(**limits), room(), np.random.default_rng(3)
    truth, odom, _ = drive(made, occupancy)
    for turn in range(6):
        scan = scan_at(occupancy, truth, rng)
        lost = (np.arange(len(scan.ranges)) % 10 < 7) & (turn % 2 == 1)
        flickering = dataclasses.replace(scan, ranges=np.where(lost, nothing, scan.ranges), range_max=3.5)
        assert made.process(odom, flickering, IDENTITY) is None


@pytest.mark.parametrize("value", [0, 100, -1])
def test_maps_of_one_kind_of_cell_do_no_harm(value):
    occupancy = OccupancyMap(np.full((40, 40), value, dtype=np.int8), 0.05, ORIGIN)
    made = Localizer(LocalizerParameters(max_particles=300), occupancy, np.random.default_rng(1))
    if value != 0:
        with pytest.raises(ValueError, match="no free cell"):
            made.globalize()
    estimate = made.process(IDENTITY, scan_at(room(), START), IDENTITY)
    assert np.isfinite(np.array(estimate.pose)).all()


def test_parameters_take_effect_at_once_and_particles_stay():
    made = localizer(robust=False)
    drive(made, room(), updates=3)
    before = made.poses
    made.reconfigure(made.parameters.replace(laser_model_type="beam", max_particles=600, laser_likelihood_max_dist=1.0))
    assert made.poses is before
    assert made.field.max_distance == 1.0
    drive(made, room(), updates=1)
    assert len(made.poses) <= 600


@pytest.mark.parametrize("seed", range(4))
def test_a_robot_carried_off_is_found_with_recovery_on(seed):
    made = localizer(seed=seed, recovery_alpha_slow=0.001, recovery_alpha_fast=0.1, max_particles=3000)
    occupancy, rng = room(), np.random.default_rng(2)
    drive(made, occupancy, updates=5)
    truth, _, estimates = drive(made, occupancy, updates=15, start=Pose2D(-1.5, 2.5, 2.0), rng=rng)
    assert estimates[-1].pose.distance_to(truth) < 0.25


def test_the_plain_filter_throws_random_poses_in_when_the_fit_drops():
    made = localizer(robust=False, recovery_alpha_slow=0.001, recovery_alpha_fast=0.2)
    occupancy = room()
    drive(made, occupancy, updates=5)
    assert np.ptp(made.poses[:, 0]) < 2.0
    drive(made, occupancy, updates=1, start=Pose2D(-1.5, 2.5, 2.0))
    assert np.ptp(made.poses[:, 0]) > 7.0
    made = localizer(robust=False)
    drive(made, occupancy, updates=5)
    drive(made, occupancy, updates=1, start=Pose2D(-1.5, 2.5, 2.0))
    assert np.ptp(made.poses[:, 0]) < 6.0


def test_anywhere_is_found():
    made, occupancy = localizer(max_particles=3000), room()
    made.globalize()
    assert np.ptp(made.poses[:, 0]) > 6.0
    truth, _, estimates = drive(made, occupancy, updates=10, start=Pose2D(-1.5, 2.5, 2.0))
    assert estimates[-1].pose.distance_to(truth) < 0.1


@pytest.mark.parametrize("setting", [{"laser_z_rand": 0.5}, {"laser_max_beams": 20}, {"laser_sigma_hit": 0.4}])
@pytest.mark.parametrize("model", ["beam", "likelihood_field_prob"])
def test_who_chooses_a_laser_model_has_its_parameters_in_the_robust_form_too(model, setting):
    told = [
        drive(localizer(laser_model_type=model, **values), room(), updates=4)[2][-1].covariance
        for values in ({}, setting)
    ]
    assert not np.allclose(told[0], told[1], rtol=1e-3)


def test_beams_are_skipped_in_the_robust_form_too():
    """A row of people stands where the map has nothing: three beams of ten, which few particles explain."""
    occupancy, told = room(), []
    for skip in (False, True):
        made = localizer(laser_model_type="likelihood_field_prob", do_beamskip=skip, laser_max_beams=180)
        for index in range(3):
            scan = scan_at(occupancy, START, np.random.default_rng(index))
            scan.ranges[20:74] = 0.5
            made.request_update()
            made.process(IDENTITY, scan, IDENTITY)
        told.append(made.log_likelihood)
    assert told[1] > told[0] + 1.0
