"""With robust off the filter does as amcl, but for the differences the package's docstring lists: each is held here.

What amcl does is written out once more in the plainest form, after its sources' behaviour (navigation, noetic-devel).
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from synthetic_room import ORIGIN, room, scan_at

from mbf_relay.geometry import IDENTITY, Pose2D
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.estimate import estimate
from mbf_relay.localization.laser_models import make_laser_model
from mbf_relay.localization.localizer import Localizer
from mbf_relay.localization.motion_models import make_motion_model
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.resampling import AverageLikelihood, particle_limits, resample
from mbf_relay.maps import OccupancyMap
from mbf_relay.scan import LaserScan

START = Pose2D(1.5, 0.5, 0.3)
NARROW = np.diag([0.02, 0.02, 0.01])


def localizer(start=START, **values):
    values = {"min_particles": 100, "max_particles": 1000, "robust": False, "resample_interval": 1, **values}
    made = Localizer(LocalizerParameters(**values), room(), np.random.default_rng(1))
    made.set_initial_pose(start, NARROW)
    return made


def amcl_likelihood(kind, field, scan, laser, pose, parameters):
    """Return the weight amcl gives a particle; cells as costmap_2d has them."""
    v, count = parameters, len(scan.ranges)
    down, up = max(1, (count - 1) // (v.laser_max_beams - 1)), -(-count // v.laser_max_beams)
    step = down if kind == "likelihood_field" else up
    range_max = min(scan.range_max, v.laser_max_range) if v.laser_max_range > 0.0 else scan.range_max
    total, product = 1.0, 1.0
    eye = Pose2D(*pose).compose(laser)
    for index in range(0, count, step):
        reading = scan.ranges[index]
        if math.isnan(reading) or reading <= scan.range_min or reading >= range_max:
            continue
        bearing = eye.theta + scan.angle_min + index * scan.angle_increment
        x, y = eye.x + reading * math.cos(bearing), eye.y + reading * math.sin(bearing)
        column, row = math.floor((x - ORIGIN.x) / field.resolution), math.floor((y - ORIGIN.y) / field.resolution)
        inside = 0 <= column < field.codes.shape[1] and 0 <= row < field.codes.shape[0]
        z = float(field.cell_distances[field.codes[row, column]]) if inside else v.laser_likelihood_max_dist
        pz = v.laser_z_hit * math.exp(-z * z / (2.0 * v.laser_sigma_hit ** 2)) + v.laser_z_rand / range_max
        total += pz ** 3
        product *= pz
    return total if kind == "likelihood_field" else product


@pytest.mark.parametrize("kind", ["likelihood_field", "likelihood_field_prob"])
@pytest.mark.parametrize("laser_max_range", [-1.0, 2.5])
@pytest.mark.parametrize("laser", [IDENTITY, Pose2D(0.1, -0.2, 2.0)])
def test_particles_weigh_what_they_do_in_amcl(kind, laser_max_range, laser):
    parameters = LocalizerParameters(laser_model_type=kind, laser_max_range=laser_max_range, laser_max_beams=20)
    field = DistanceField(room(), 2.0)
    scan = scan_at(room(), START.compose(laser), np.random.default_rng(2), beams=100)
    scan.ranges[[5, 20]] = math.nan, 0.05
    poses = np.array(START) + np.random.default_rng(3).normal(0.0, 0.3, (50, 3))
    model = make_laser_model(field, parameters)
    got = np.exp(model.log_likelihoods(poses, model.pick(scan, laser)))
    wanted = [amcl_likelihood(kind, field, scan, laser, pose, parameters) for pose in poses]
    assert got == pytest.approx(np.array(wanted), rel=1e-3)


def test_cells_lie_where_the_map_message_puts_them():
    """amcl takes a cell's corner for its centre, half a cell off everything else that reads the map; we do not."""
    data = np.zeros((40, 40), dtype=np.int8)
    data[20, 30] = 100
    field = DistanceField(OccupancyMap(data, 0.1, IDENTITY), 2.0)
    model = make_laser_model(field, LocalizerParameters())
    for x, inside in ((3.01, True), (3.09, True), (2.97, False), (3.13, False)):
        beams = model.pick(LaserScan(np.array([x - 1.0]), 0.0, 0.1, 0.0, 8.0, 0.0), IDENTITY)
        log = model.log_likelihoods(np.array([[1.0, 2.05, 0.0]]), beams)[0]
        assert (log == pytest.approx(math.log1p((0.95 + 0.05 / 8.0) ** 3), rel=1e-5)) == inside


def test_cells_between_free_and_occupied_count_by_the_usual_thresholds():
    """amcl knows only 0 and 100; maps of other tools, which hold every value, would have no walls."""
    data = np.array([[0, 25, 26, 64, 65, 100, -1]], dtype=np.int8)
    field = DistanceField(OccupancyMap(data, 1.0, IDENTITY), 9.0)
    assert field.blocked[0].tolist() == [0, 0, 1, 1, 1, 1, 1]
    assert (field.distances[0] == 0.0).tolist() == [False, False, False, False, True, True, False]


def test_a_beam_that_came_back_from_nothing_is_a_max_reading_to_the_beam_model():
    """REP 117's infinity is table 6.1's p_max; amcl, older than the REP, gives it no likelihood at all."""
    parameters = LocalizerParameters(laser_model_type="beam", laser_max_beams=2)
    model = make_laser_model(DistanceField(room(), 2.0), parameters)
    beams = [model.pick(LaserScan(np.full(2, r), 0.0, 0.1, 0.1, 3.0, 0.0), IDENTITY) for r in (math.inf, 3.0, 4.0)]
    first, *others = [model.log_likelihoods(np.array([START]), picked)[0] for picked in beams]
    assert first > 0.0 and others == [first, first]


def test_beams_are_skipped_only_once_the_particles_were_drawn_close_together():
    parameters = LocalizerParameters(laser_model_type="likelihood_field_prob", do_beamskip=True, laser_max_beams=180)
    model = make_laser_model(DistanceField(room(), 2.0), parameters)
    ranges = scan_at(room(), START).ranges.copy()
    ranges[:20] = 0.4  # somebody stands there
    beams = model.pick(LaserScan(ranges, 0.0, 2.0 * math.pi / 180.0, 0.12, 6.0, 0.0), IDENTITY)
    poses = np.array(START) + np.random.default_rng(1).normal(0.0, 0.02, (100, 3))
    every, some = (model.log_likelihoods(poses, beams, converged) for converged in (False, True))
    assert (some > every + 10.0).all()


def test_convergence_is_judged_when_particles_are_drawn():
    made, seen = localizer(resample_interval=2, do_beamskip=True), []
    weigh = made._laser_model.log_likelihoods
    made._laser_model.log_likelihoods = lambda *given_in: seen.append(given_in[2]) or weigh(*given_in)
    for step in range(5):
        if step == 4:
            made.set_initial_pose(START, NARROW)
        truth = START.compose(Pose2D(0.3 * (step % 4), 0.0, 0.0))
        made.process(Pose2D(0.3 * step, 0.0, 0.0), scan_at(room(), truth), IDENTITY)
    assert seen == [False, False, True, True, False]


@given(st.lists(st.floats(1e-6, 1.0), min_size=1, max_size=30), st.floats(0.001, 0.5), st.floats(0.001, 0.9))
def test_doubt_is_amcls_recursion(averages, alpha_slow, alpha_fast):
    """w += alpha (average - w) for both, from the first average on; the random share is 1 - fast / slow.

    amcl divides the average by the number of particles once more, so that a change of their number looks like doubt.
    """
    ours, slow, fast = AverageLikelihood(), 0.0, 0.0
    for average in averages:
        ours.update(math.log(average), alpha_slow, alpha_fast)
        slow = average if slow == 0.0 else slow + alpha_slow * (average - slow)
        fast = average if fast == 0.0 else fast + alpha_fast * (average - fast)
    assert ours.random_share() == pytest.approx(max(0.0, 1.0 - fast / slow), abs=1e-9)


def test_a_doubt_that_was_acted_on_is_forgotten():
    made = localizer(recovery_alpha_slow=0.001, recovery_alpha_fast=0.5)
    for step in range(4):
        made.process(
            Pose2D(0.3 * step, 0.0, 0.0), scan_at(room(), START.compose(Pose2D(0.3 * step, 0.0, 0.0))), IDENTITY
        )
    made.process(Pose2D(1.5, 0.0, 0.0), scan_at(room(), Pose2D(-1.5, 2.5, 2.0)), IDENTITY)
    assert np.ptp(made.poses[:, 0]) > 5.0
    assert made._averages.random_share() == 0.0


def test_drawing_stops_at_the_limit_of_the_bins_filled_so_far():
    """amcl draws one more than Fox's limit; a limit is a limit."""
    limits = particle_limits(5000, 100, 0.02, 0.99)
    poses = np.random.default_rng(1).uniform((0.0, 0.0, -3.0), (3.0, 3.0, 3.0), (500, 3))
    drawn = resample(poses, np.ones(500), limits, np.random.default_rng(2))
    bins = {tuple(np.floor(p / (0.5, 0.5, math.pi / 18.0)).astype(int)) for p in drawn}
    before = {tuple(np.floor(p / (0.5, 0.5, math.pi / 18.0)).astype(int)) for p in drawn[:-1]}
    assert len(drawn) >= limits[len(bins)]
    assert len(drawn) - 1 < limits[len(before)]


def test_the_covariance_is_that_of_all_particles_the_pose_of_the_heaviest_cluster():
    rng = np.random.default_rng(4)
    poses = np.vstack((rng.normal((0.2, 0.2, 0.5), 0.03, (200, 3)), rng.normal((4.2, 2.2, -1.0), 0.03, (200, 3))))
    weights = np.repeat([0.3 / 200, 0.7 / 200], 200)
    found = estimate(poses, weights)
    heavy, share = poses[200:], weights / weights.sum()
    assert tuple(found.pose) == pytest.approx((heavy[:, 0].mean(), heavy[:, 1].mean(), heavy[:, 2].mean()), abs=1e-3)
    x, y = share @ poses[:, 0], share @ poses[:, 1]
    assert found.covariance[0, 1] == pytest.approx(share @ (poses[:, 0] * poses[:, 1]) - x * y)
    length = math.hypot(share @ np.cos(poses[:, 2]), share @ np.sin(poses[:, 2]))
    assert found.covariance[2, 2] == pytest.approx(-2.0 * math.log(length))


@pytest.mark.parametrize("driven, sideways", [(0.0099, 0.0), (0.0101, math.pi / 2.0)])
def test_a_motion_below_a_centimetre_has_no_direction(driven, sideways):
    """A step to the side is a turn, a step and a turn back from 1 cm on; below it is taken for a step ahead."""
    alphas = {f"odom_alpha{index}": 0.0 for index in range(1, 6)}
    model = make_motion_model(LocalizerParameters(robust=False, **alphas))
    moved = model.propagate(np.zeros((1, 3)), IDENTITY, Pose2D(0.0, driven, 0.0), np.random.default_rng(1))[0]
    assert moved == pytest.approx([driven * math.cos(sideways), driven * math.sin(sideways), 0.0], abs=1e-12)


@pytest.mark.parametrize(
    "moved, updates", [((0.2, 0.0, 0.0), False), ((0.2001, 0.0, 0.0), True), ((0.0, -0.2001, 0.0), True),
                       ((0.15, 0.15, 0.0), False), ((0.0, 0.0, -0.3), False), ((0.0, 0.0, -0.3001), True)],
)
def test_an_update_takes_more_than_the_least_motion_along_an_axis(moved, updates):
    made = localizer(update_min_d=0.2, update_min_a=0.3)
    made.process(IDENTITY, scan_at(room(), START), IDENTITY)
    assert (made.process(Pose2D(*moved), scan_at(room(), START), IDENTITY) is not None) == updates


def test_a_request_before_the_first_scan_is_left_to_the_second():
    made, scan = localizer(), scan_at(room(), START)
    made.request_update()
    assert [made.process(IDENTITY, scan, IDENTITY) is not None for _ in range(3)] == [True, True, False]


def test_particles_are_drawn_at_every_nth_update_from_a_start_on():
    made, counts = localizer(resample_interval=3, laser_sigma_hit=0.05), []
    for step in range(7):
        if step == 4:
            made.set_initial_pose(START, NARROW)
        at = step if step < 4 else step - 4
        made.process(Pose2D(0.3 * step, 0.0, 0.0), scan_at(room(), START.compose(Pose2D(0.3 * at, 0.0, 0.0))), IDENTITY)
        counts.append(np.ptp(made.weights) < 1e-12)
    assert counts == [False, False, True, False, False, False, True]


def test_every_update_has_an_estimate_of_the_weighed_particles():
    """amcl has one at every drawing only, of the drawn particles, which says later what it says less exactly."""
    made = localizer(resample_interval=10)
    for step in range(3):
        found = made.process(
            Pose2D(0.3 * step, 0.0, 0.0), scan_at(room(), START.compose(Pose2D(0.3 * step, 0.0, 0.0))), IDENTITY
        )
        assert tuple(found.pose) == pytest.approx(tuple(estimate(made.poses, made.weights).pose))


def test_another_map_keeps_the_particles_and_is_looked_at_with_the_next_scan():
    made, scan = localizer(), scan_at(room(), START)
    made.process(IDENTITY, scan, IDENTITY)
    before = made.poses
    small = OccupancyMap(room().data[:60, :70].copy(), 0.05, ORIGIN)
    made.set_map(small)
    assert made.poses is before
    assert made.process(IDENTITY, scan, IDENTITY) is not None
    assert made.process(IDENTITY, scan, IDENTITY) is None
    assert np.isfinite(made.poses).all()
