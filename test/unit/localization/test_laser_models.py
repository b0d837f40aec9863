import math

import numpy as np
import pytest
from synthetic_room import room, scan_at

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.beams import Beams, pick_beams, step_between
from mbf_relay.localization.distance_field import DistanceField, distances_to
from mbf_relay.localization.laser_kernels import cast_ray, look_up_endpoints, sum_over_endpoints, trace_endpoints
from mbf_relay.localization.laser_models import is_converged, make_laser_model
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.maps import OccupancyMap
from mbf_relay.scan import LaserScan


def wall_ahead():
    """Return a map whose only wall fills the cells with x in [5.0, 5.1): its cells' centres are at 5.05."""
    data = np.zeros((100, 100), dtype=np.int8)
    data[:, 50] = 100
    return OccupancyMap(data, 0.1, Pose2D(0.0, 0.0, 0.0))


def one_beam(reading, range_max=8.0):
    return pick_beams(LaserScan(np.array([reading]), 0.0, 0.1, 0.0, range_max, 0.0), IDENTITY, 1)


def weigh(kind, reading, pose=(2.05, 5.05, 0.0), range_max=8.0, **values):
    parameters = LocalizerParameters(laser_model_type=kind, **values)
    model = make_laser_model(DistanceField(wall_ahead(), parameters.laser_likelihood_max_dist), parameters)
    return math.exp(model.log_likelihoods(np.array([pose]), one_beam(reading, range_max))[0])


@pytest.mark.parametrize("error", [0.0, 0.1, 0.2, -0.3, 1.0])
def test_likelihood_field_weighs_a_beam_by_its_end(error):
    pz = 0.95 * math.exp(-error ** 2 / (2 * 0.2 ** 2)) + 0.05 / 8.0
    assert weigh("likelihood_field", 3.0 + error) == pytest.approx(1.0 + pz ** 3, rel=1e-4)


@pytest.mark.parametrize("error", [0.0, 0.1, -0.3])
def test_likelihood_field_prob_multiplies(error):
    pz = 0.95 * math.exp(-error ** 2 / (2 * 0.2 ** 2)) + 0.05 / 8.0
    assert weigh("likelihood_field_prob", 3.0 + error) == pytest.approx(pz, rel=1e-4)


def test_far_from_everything_and_off_the_map_count_as_the_largest_distance():
    pz = 0.95 * math.exp(-0.5 ** 2 / (2 * 0.2 ** 2)) + 0.05 / 8.0
    for reading, pose in ((1.0, (2.05, 5.05, 0.0)), (4.0, (9.0, 5.05, 0.0))):
        assert weigh("likelihood_field", reading, pose, laser_likelihood_max_dist=0.5) == pytest.approx(
            1.0 + pz**3, rel=1e-4
        )


@pytest.mark.parametrize("error", [0.001, 0.15, 0.5])
def test_beam_model_weighs_hits_and_random_readings(error):
    # The ray is taken to end half a cell into the wall's cell, at its centre.
    pz = 0.95 * math.exp(-error ** 2 / (2 * 0.2 ** 2)) + 0.05 / 8.0
    assert weigh("beam", 3.0 + error) == pytest.approx(1.0 + pz ** 3, rel=1e-6)


def test_beam_model_knows_short_readings_and_none():
    short = 0.95 * math.exp(-(1.0 ** 2) / (2 * 0.2 ** 2)) + 0.1 * 0.1 * math.exp(-0.1 * 2.0) + 0.05 / 8.0
    assert weigh("beam", 2.0) == pytest.approx(1.0 + short ** 3, rel=1e-6)
    assert weigh("beam", math.inf) == pytest.approx(1.0 + 0.05 ** 3, rel=1e-6)


@pytest.mark.parametrize("kind", ["likelihood_field", "likelihood_field_prob"])
@pytest.mark.parametrize("reading", [math.inf, math.nan, 8.0, 0.0])
def test_field_models_leave_out_readings_that_are_none(kind, reading):
    assert weigh(kind, reading) == 1.0


def test_many_beams_do_not_underflow():
    room_map = room()
    parameters = LocalizerParameters(
        laser_model_type="likelihood_field_prob", laser_max_beams=2000, laser_sigma_hit=0.01
    )
    model = make_laser_model(DistanceField(room_map, 2.0), parameters)
    beams = model.pick(scan_at(room_map, Pose2D(1.5, 0.5, 0.0), beams=2000), IDENTITY)
    logs = model.log_likelihoods(np.array([[1.5, 0.5, 0.0], [2.2, 1.2, 0.5], [1.0, 1.2, 2.0]]), beams)
    assert np.isfinite(logs).all()
    assert logs[1] < -2000.0  # whose exponential is zero
    assert logs[0] > logs[1]


@pytest.mark.parametrize("reach", [4.0, 0.9])
@pytest.mark.parametrize("origin", [Pose2D(-3.0, -2.0, 0.0), Pose2D(1.0, 2.0, 0.7)])
def test_endpoint_kernel_is_what_plain_numpy_gives(origin, reach):
    """With all beams long enough to leave the map from most poses, and with all so short that they cannot.

    Sums may take a beam that ends within 1e-4 of a cell's border for one that ends beyond it.
    """
    rng, field = np.random.default_rng(3), DistanceField(room(origin), 2.0)
    poses = origin.transform_poses(rng.uniform((-1.0, -1.0, -3.0), (9.0, 7.0, 3.0), (200, 3)))
    endpoints = rng.uniform(-reach, reach, (50, 2))
    sums, values = np.empty(200), np.empty((200, 50), dtype=np.float32)
    sum_over_endpoints(poses, endpoints, field.codes, field.cell_distances, 7.0, field.frame, sums)
    look_up_endpoints(poses, endpoints, field.codes, field.cell_distances, 7.0, field.frame, values)
    for pose, total, row in zip(poses, sums, values):
        points = origin.inverse().transform_points(Pose2D(*pose).transform_points(endpoints))
        expected = []
        for aside in ((0.0, 0.0), (1e-4, 1e-4), (1e-4, -1e-4), (-1e-4, 1e-4), (-1e-4, -1e-4)):
            cells = np.floor(points / 0.05 + aside).astype(int)
            inside = (cells >= 0).all(axis=1) & (cells < (160, 120)).all(axis=1)
            clipped = np.clip(cells, 0, (159, 119))
            expected.append(np.where(inside, field.distances[clipped[:, 1], clipped[:, 0]], 7.0))
        assert row == pytest.approx(expected[0], abs=1e-6)
        least, most = np.min(expected, axis=0).sum(), np.max(expected, axis=0).sum()
        assert least * (1.0 - 1e-5) <= total <= most * (1.0 + 1e-5)


@pytest.mark.parametrize("strange", [math.nan, math.inf, -math.inf, 1e300])
def test_numbers_that_are_none_end_off_the_map(strange):
    field, sums = DistanceField(room(), 2.0), np.empty(3)
    ends, outside = np.zeros((6, 2)), 7.0
    poses = np.array([[0.0, 0.0, 0.0], [strange, 0.0, 0.0], [0.0, 0.0, strange]])
    for strange_ends in (0, 1):
        ends[2] = strange if strange_ends else 0.0
        sum_over_endpoints(poses, ends, field.codes, field.cell_distances, outside, field.frame, sums)
        assert np.isfinite(sums).all()
        assert sums[1] == 6 * outside
        assert sums[0] != 6 * outside


def test_rays_end_where_small_steps_meet_a_wall():
    rng, field = np.random.default_rng(4), DistanceField(room(), 2.0)
    for _ in range(300):
        column, row, angle = rng.uniform(3, 155), rng.uniform(3, 115), rng.uniform(-7.0, 7.0)
        if field.blocked[int(row), int(column)]:
            assert cast_ray(field.blocked, column, row, angle, 50.0) == 0.0
            continue
        steps = np.arange(0.0, 50.0, 0.002)
        x = np.floor(column + steps * math.cos(angle)).astype(int)
        y = np.floor(row + steps * math.sin(angle)).astype(int)
        inside = (x >= 0) & (y >= 0) & (x < 160) & (y < 120)
        hit = ~inside | (field.blocked[np.clip(y, 0, 119), np.clip(x, 0, 159)] != 0)
        expected = min(50.0, steps[np.argmax(hit)] + 0.5) if hit.any() else 50.0
        assert cast_ray(field.blocked, column, row, angle, 50.0) == pytest.approx(expected, abs=0.3)


def test_distances_are_those_to_the_nearest_occupied_cell():
    rng = np.random.default_rng(5)
    occupied = rng.random((30, 40)) < 0.02
    cells = np.argwhere(occupied)
    rows, columns = np.mgrid[:30, :40]
    expected = (
        np.sqrt(((rows[..., None] - cells[:, 0]) ** 2 + (columns[..., None] - cells[:, 1]) ** 2).min(axis=2)) * 0.1
    )
    assert distances_to(occupied, 0.1, 1.0) == pytest.approx(np.minimum(expected, 1.0), abs=1e-5)
    assert (distances_to(np.zeros((4, 4), dtype=bool), 0.1, 1.0) == 1.0).all()


def test_steps_between_beams_are_amcls():
    assert [step_between(360, 180, False), step_between(360, 30, False), step_between(10, 30, False)] == [2, 12, 1]
    assert [step_between(360, 180, True), step_between(361, 180, True), step_between(10, 30, True)] == [2, 3, 1]


def test_limits_of_user_and_scan_both_hold():
    scan = LaserScan(np.array([0.05, 0.2, 1.0, 3.0, 9.0, np.nan]), 0.0, 0.1, 0.12, 3.5, 0.0)
    beams = pick_beams(scan, Pose2D(1.0, 2.0, 0.5), 1, laser_min_range=0.5, laser_max_range=2.0)
    assert beams.ranges.tolist() == [2.0, 2.0, 1.0, 2.0, 2.0]
    assert beams.hits == pytest.approx(np.array([[1.0 + math.cos(0.7), 2.0 + math.sin(0.7)]]))
    with pytest.raises(ValueError, match="reaches from"):
        pick_beams(LaserScan(np.ones(3), 0.0, 0.1, 0.1, -1.0, 0.0), IDENTITY, 1)


@pytest.mark.parametrize("step", [1, 3])
def test_beams_are_picked_as_plain_numpy_has_it(step):
    rng = np.random.default_rng(step)
    ranges = rng.choice([0.05, 1.0, 2.5, 3.5, 4.0, np.inf, -np.inf, np.nan], 400) + rng.choice([0.0, 0.1], 400)
    scan, laser = LaserScan(ranges, -3.0, 0.015, 0.12, 3.5, 0.0), Pose2D(0.1, -0.2, 0.7)
    beams = pick_beams(scan, laser, step)
    known = ~np.isnan(ranges[::step])
    picked, bearings = ranges[::step][known], (scan.angles[::step] + laser.theta)[known]
    hit = (picked > 0.12) & (picked < 3.5)
    nothing = np.concatenate(([True], picked >= 3.5, [True]))
    assert beams.ranges.tolist() == np.where(hit, picked, 3.5).tolist()
    assert beams.bearings == pytest.approx(bearings, abs=1e-12)
    ends = beams.ranges * np.array([np.cos(bearings), np.sin(bearings)])
    assert beams.endpoints == pytest.approx(ends.T + (laser.x, laser.y), abs=1e-12)
    assert beams.silent.tolist() == (nothing[:-2] & nothing[1:-1] & nothing[2:]).tolist()


def test_beam_skipping_leaves_out_what_few_particles_explain_but_not_everything():
    parameters = LocalizerParameters(laser_model_type="likelihood_field_prob", do_beamskip=True, laser_max_beams=180)
    room_map = room()
    model = make_laser_model(DistanceField(room_map, 2.0), parameters)
    pose = Pose2D(1.5, 0.5, 0.3)
    scan = scan_at(room_map, pose)
    ranges = scan.ranges.copy()
    ranges[:20] = 0.4  # a person close by
    beams = model.pick(LaserScan(ranges, 0.0, scan.angle_increment, 0.12, 6.0, 0.0), IDENTITY)
    poses = np.array(pose) + np.random.default_rng(1).normal(0.0, 0.02, (200, 3))
    kept = model.beams_to_keep(poses, beams.hits)
    assert kept.sum() == len(beams.hits) - 20
    ranges, none = np.full(40, 0.4), np.zeros(40, dtype=bool)
    everything_short = Beams(ranges, np.zeros(40), np.full((40, 2), 0.3), none, IDENTITY, 6.0)
    assert model.beams_to_keep(poses, everything_short.hits).all()
    assert is_converged(poses)
    assert not is_converged(np.vstack((poses, [[3.0, 0.5, 0.0]])))


@pytest.mark.parametrize("robust", [False, True])
@pytest.mark.parametrize("model", ["beam", "likelihood_field", "likelihood_field_prob"])
def test_a_lidar_said_to_err_by_nothing_is_taken_to_err_by_a_millimetre(model, robust):
    """The square of so small a number is 0: amcl ended with a traceback."""
    given = {"laser_sigma_hit": 1e-300, "laser_model_type": model, "robust": robust}
    parameters, notes = LocalizerParameters.read(given)
    assert parameters.laser_sigma_hit == 0.001 and "laser_sigma_hit" in notes[0]
    made, start = Localizer(parameters, room(), np.random.default_rng(1)), Pose2D(1.5, 0.5, 0.3)
    made.set_initial_pose(start, np.diag([0.02, 0.02, 0.01]))
    assert made.process(start, scan_at(room(), start, np.random.default_rng(2)), IDENTITY).pose.is_finite()


@pytest.mark.parametrize("model", ["beam", "likelihood_field", "likelihood_field_prob"])
def test_a_robot_s_lidar_may_sit_anywhere_and_its_map_lie_turned(model):
    """Each pose weighs what that of the lidar does where the map's axes are the frame's."""
    rng, turned, laser = np.random.default_rng(6), Pose2D(1.0, 2.0, 0.7), Pose2D(0.3, -0.2, 2.0)
    parameters = LocalizerParameters(laser_model_type=model)
    plain, other = (make_laser_model(DistanceField(room(origin), 2.0), parameters) for origin in (IDENTITY, turned))
    scan = scan_at(room(IDENTITY), Pose2D(4.5, 2.5, 0.3), rng, beams=60)
    eyes = np.array([4.5, 2.5, 0.3]) + rng.normal(0.0, 0.3, (40, 3))
    robots = np.array([turned.compose(Pose2D(*eye)).compose(laser.inverse()) for eye in eyes])
    expected = plain.log_likelihoods(eyes, plain.pick(scan, IDENTITY))
    assert other.log_likelihoods(robots, other.pick(scan, laser)) == pytest.approx(expected, rel=0.02)


def test_beams_that_pass_through_a_wall_are_those_that_small_steps_find_in_one():
    rng, origin, margin = np.random.default_rng(5), Pose2D(1.0, 2.0, 0.7), 0.3
    occupancy, laser = room(origin), Pose2D(0.2, -0.1, 0.0)
    field, through = DistanceField(occupancy, 2.0), np.empty((6, 300), np.uint8)
    eyes = [Pose2D(*pose) for pose in rng.uniform((0.3, 0.3, -3.0), (7.7, 5.7, 3.0), (6, 3))]
    eyes[0] = Pose2D(3.25, 2.02, 0.5)  # a little inside a wall, as a pose may be by an error
    robots = [origin.compose(eye).compose(laser.inverse()) for eye in eyes]
    ends = rng.uniform(-3.5, 3.5, (300, 2))
    ends[:40] = laser[:2] + 0.08 * ends[:40]  # so near that nothing of the beam is looked at
    trace_endpoints(
        np.array(robots), ends, np.array(laser[:2]), field.codes, field.cell_distances, field.frame, margin, through)
    for eye, robot, row in zip(eyes, robots, through):
        for end, told in zip(origin.inverse().transform_points(robot.transform_points(ends)), row):
            length = math.hypot(end[0] - eye.x, end[1] - eye.y)
            shares = np.arange(margin, length - margin, 0.002)[:, None] / length
            cells = np.floor((np.array(eye[:2]) + shares * (end - eye[:2])) / 0.05).astype(int)
            inside = ((cells >= 0) & (cells < (160, 120))).all(axis=1)
            cells = cells[: np.argmin(inside) if not inside.all() else len(cells)]
            in_wall = np.count_nonzero(occupancy.data[cells[:, 1], cells[:, 0]] == 100)
            assert told == (in_wall > 0) or 0 < in_wall < 35, "corners of walls, which are 0.1 m thick, may be missed"
    assert 100 < through.sum() < 1700
