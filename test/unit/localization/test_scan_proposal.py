import math

import numpy as np
import pytest
from benchmark.synthetic_drives import Rough, make_drive
from synthetic_room import room, scan_at

from mbf_relay.geometry import IDENTITY, Pose2D, normalize_angles
from mbf_relay.localization.beams import pick_beams
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.estimate import deviation_of, mean_and_covariance
from mbf_relay.localization.gaussians import FLOOR, PoseGaussian, PoseMixture, log_sum_exp
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.refinement_kernels import invert, linearize
from mbf_relay.localization.replay import errors, replay
from mbf_relay.localization.scan_likelihood import ScanLikelihood, apart, thin_out
from mbf_relay.localization.scan_proposal import ScanProposal
from mbf_relay.localization.tracker import Doubt
from mbf_relay.maps import OccupancyMap

TRUTH = Pose2D(1.5, 0.5, 0.3)
ODOMETRY = np.diag([0.15, 0.15, 0.1]) ** 2


def corridor():
    """Return a bare corridor of 20 m x 2 m along x, open at both ends."""
    data = np.zeros((60, 400), dtype=np.int8)
    data[8:10] = data[50:52] = 100
    return OccupancyMap(data, 0.05, Pose2D(0.0, 0.0, 0.0))


def hits(occupancy, pose):
    return pick_beams(scan_at(occupancy, pose, np.random.default_rng(1)), IDENTITY, 1).hits


def likelihood(occupancy):
    return ScanLikelihood(DistanceField(occupancy, 2.0), 0.2)


def test_the_gradient_is_the_slope_of_the_squared_distances():
    """Where every beam counts in full, the gradient is that of sum(d^2) / (2 sigma^2), here by differences."""
    field, sigma = DistanceField(room(), 2.0), 50.0
    endpoints, pose = hits(room(), TRUTH), np.array(TRUTH) + (0.03, -0.02, 0.01)
    information, gradient, maps = np.empty((3, 3)), np.empty(3), (field.codes, field.face_distances)

    def half_squares(at):
        total, column = 0.0, np.empty(3)
        for endpoint in endpoints:
            matrix = np.empty((3, 3))
            linearize(at, endpoint[None, :].copy(), *maps, field.frame, sigma, 1e-12, matrix, column)
            # A single beam's J d and J J^T give d back: d^2 = (g . g) / trace(J J^T), in units of 1 / sigma^2.
            trace = np.trace(matrix)
            total += 0.5 * float(column @ column) / trace if trace > 0.0 else 0.0
        return total

    linearize(pose, endpoints, *maps, field.frame, sigma, 1e-12, information, gradient)
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-5
        slope = (half_squares(pose + step) - half_squares(pose - step)) / 2e-5
        assert gradient[axis] == pytest.approx(slope, rel=0.05, abs=2e-4)


def test_inverse_of_a_symmetric_matrix():
    rng, inverse = np.random.default_rng(1), np.empty((3, 3))
    for _ in range(20):
        root = rng.normal(size=(3, 3))
        matrix = root @ root.T + 0.1 * np.eye(3)
        assert invert(matrix, inverse)
        assert inverse @ matrix == pytest.approx(np.eye(3), abs=1e-9)
    assert not invert(np.zeros((3, 3)), inverse)


@pytest.mark.parametrize("origin", [Pose2D(-3.0, -2.0, 0.0), Pose2D(1.0, 2.0, 0.7)])
def test_climbing_leads_to_the_truth(origin):
    occupancy = room(origin)
    truth = origin.compose(Pose2D(4.5, 2.5, 0.3))
    prior = PoseGaussian(np.array(truth) + (0.2, -0.15, 0.12), ODOMETRY)
    modes = likelihood(occupancy).modes(prior.mean[None, :], prior, thin_out(hits(occupancy, truth)))
    assert modes.poses[0] == pytest.approx(np.array(truth), abs=0.02)
    assert modes.explained[0] > 0.7


def test_a_bare_corridor_leaves_the_way_along_it_to_odometry():
    occupancy, truth = corridor(), Pose2D(10.0, 1.5, 0.0)
    prior = PoseGaussian(np.array([10.3, 1.4, 0.05]), ODOMETRY)
    modes = likelihood(occupancy).modes(prior.mean[None, :], prior, thin_out(hits(occupancy, truth)))
    assert modes.poses[0, 0] == pytest.approx(10.3, abs=0.02)
    assert modes.poses[0, 1:] == pytest.approx([1.5, 0.0], abs=0.02)
    assert math.sqrt(modes.covariances[0, 0, 0]) == pytest.approx(0.15, rel=0.1)
    assert math.sqrt(modes.covariances[0, 1, 1]) < 0.05


def test_particles_stay_a_sample_of_prior_times_likelihood():
    """In a bare corridor the posterior is known: across from the scan, along as odometry had it."""
    occupancy, truth = corridor(), Pose2D(10.0, 1.5, 0.0)
    prior = PoseGaussian(np.array([10.3, 1.45, 0.0]), ODOMETRY)
    rng = np.random.default_rng(3)
    poses = prior.sample(20000, rng)
    poses, log_weights, *_ = ScanProposal(likelihood(occupancy)).propose(
        poses, np.full(20000, -math.log(20000)), thin_out(hits(occupancy, truth)), 1.0, rng
    )
    weights = np.exp(log_weights - log_sum_exp(log_weights))
    mean = weights @ poses[:, 0]
    assert mean == pytest.approx(10.3, abs=0.02)
    assert math.sqrt(weights @ (poses[:, 0] - mean) ** 2) == pytest.approx(0.15, rel=0.1)
    assert 1.0 / np.square(weights).sum() > 2000.0


def test_a_robot_that_stands_is_not_less_sure_with_every_scan():
    """Particles have weights between two resamplings; who stays and forgets them widens the belief at every scan."""
    occupancy, proposal, rng = corridor(), ScanProposal(likelihood(corridor())), np.random.default_rng(4)
    endpoints = thin_out(hits(occupancy, Pose2D(10.0, 1.5, 0.0)))
    poses, log_weights = PoseGaussian(np.array([10.3, 1.5, 0.0]), ODOMETRY).sample(8000, rng), np.full(8000, -9.0)
    for _ in range(30):
        poses, log_weights, *_ = proposal.propose(poses, log_weights, endpoints, 0.05, rng)
    weights = np.exp(log_weights - log_sum_exp(log_weights))
    assert math.sqrt(weights @ (poses[:, 0] - weights @ poses[:, 0]) ** 2) == pytest.approx(0.15, rel=0.25)


@pytest.mark.parametrize("step", [0.05, 0.75])
def test_odometry_that_is_a_tenth_off_does_not_show_in_the_pose_where_scans_tell_it(step):
    """All beams but one in twenty hit what the map has, to within a centimetre: so near the robot must be told."""
    parameters = LocalizerParameters(update_min_d=0.0, update_min_a=0.0)
    rough = Rough(step=step, slips=0.0, unmapped=0.0, people=1)
    made = make_drive("office", 60, rough, np.random.default_rng(1))
    start = Pose2D(*map(float, made.log.reference[0]))
    result = replay(made.log, made.occupancy, parameters, np.random.default_rng(1), start, ODOMETRY)
    assert np.median(errors(result.poses, made.log.reference)["translation"][5:]) < 0.02


def test_along_a_bare_corridor_the_pose_is_left_where_odometry_has_it():
    prior = PoseGaussian(np.array([10.2, 1.6, 0.05]), ODOMETRY)
    pose = likelihood(corridor()).sharpest(prior.mean[None], prior, thin_out(hits(corridor(), Pose2D(10.0, 1.5, 0.0))))
    assert pose == pytest.approx([10.2, 1.5, 0.0], abs=0.02)


def test_particles_all_in_one_place_spread_as_far_as_they_are_told_to():
    proposal, rng = ScanProposal(likelihood(corridor())), np.random.default_rng(4)
    endpoints = thin_out(hits(corridor(), Pose2D(10.0, 1.5, 0.0)))
    poses, _, *_ = proposal.propose(np.tile((10.0, 1.5, 0.0), (4000, 1)), np.full(4000, -8.0), endpoints, 1e-9, rng)
    assert 0.9 * FLOOR[0] < poses[:, 0].std() < 1.4 * FLOOR[0]


def test_densities_are_normalised_and_samples_have_their_moments():
    part = PoseGaussian(np.array([1.0, 2.0, 3.1]), np.array([[0.04, 0.01, 0.0], [0.01, 0.09, 0.02], [0.0, 0.02, 0.05]]))
    mixture = PoseMixture((part, PoseGaussian(np.array([4.0, 2.0, 0.0]), np.eye(3) * 0.02)), np.array([0.7, 0.3]))
    x, y, a = np.meshgrid(
        np.linspace(-1, 6, 71), np.linspace(0, 4, 41), np.linspace(-math.pi, math.pi, 63, endpoint=False)
    )
    density = np.exp(mixture.log_density(np.column_stack((x.ravel(), y.ravel(), a.ravel()))))
    assert density.sum() * 0.1 * 0.1 * (2 * math.pi / 63) == pytest.approx(1.0, rel=0.01)
    fitted = PoseGaussian.fitted(part.sample(40000, np.random.default_rng(1)), np.ones(40000))
    assert fitted.mean == pytest.approx(part.mean, abs=0.01)
    assert fitted.covariance == pytest.approx(part.covariance, abs=0.004)


def test_moments_and_densities_are_what_plain_numpy_gives():
    """Sums are taken in another order, so that the last digits differ."""
    rng = np.random.default_rng(3)
    poses = np.column_stack((rng.normal(5.0, 0.3, 500), rng.normal(-2.0, 0.2, 500), rng.normal(3.1, 0.2, 500)))
    poses[:, 2], weights = normalize_angles(poses[:, 2]), rng.random(500)

    def differences(mean):
        return np.column_stack((poses[:, :2] - mean[:2], normalize_angles(poses[:, 2] - mean[2])))

    share = weights / weights.sum()
    turned = share @ np.exp(1j * poses[:, 2])
    mean = np.array([share @ poses[:, 0], share @ poses[:, 1], np.angle(turned)])
    covariance = (differences(mean) * share[:, None]).T @ differences(mean)
    fitted = PoseGaussian.fitted(poses, weights)
    assert fitted.mean == pytest.approx(mean, abs=1e-12)
    assert fitted.covariance == pytest.approx(covariance, abs=1e-12)
    told, told_covariance = mean_and_covariance(poses, weights)
    assert tuple(told) == pytest.approx(mean, abs=1e-12)
    assert told_covariance[:2, :2] == pytest.approx(covariance[:2, :2], abs=1e-12)
    assert told_covariance[2, 2] == pytest.approx(-2.0 * math.log(abs(turned)), abs=1e-12)
    assert deviation_of(told_covariance) == pytest.approx(math.sqrt(0.5 * (covariance[0, 0] + covariance[1, 1])))

    parts = (fitted, PoseGaussian(mean + (0.5, 0.0, 6.0), np.diag([0.2, 0.1, 0.3])), PoseGaussian(mean, np.eye(3)))
    shares, densities = np.array([0.6, 0.3, 0.1]), np.zeros(500)
    for part, one in zip(parts, shares):
        squares = np.einsum("ni,ij,nj->n", differences(part.mean), part.information, differences(part.mean))
        density = np.exp(-0.5 * squares) / math.sqrt((2.0 * math.pi) ** 3 * np.linalg.det(part.covariance))
        densities += one * density
        assert part.log_density(poses) == pytest.approx(np.log(density), abs=1e-9)
    mixture = PoseMixture(parts, shares)
    assert mixture.log_density(poses) == pytest.approx(np.log(densities), abs=1e-9)
    first, every = mixture.log_densities(poses)
    assert first == pytest.approx(fitted.log_density(poses), abs=1e-9)
    assert every == pytest.approx(np.log(densities), abs=1e-9)


def test_near_walls_do_not_outvote_far_ones():
    near = np.column_stack((np.full(200, 0.5), np.linspace(0.0, 0.3, 200)))
    far = np.column_stack((np.full(20, 5.0), np.linspace(0.0, 3.0, 20)))
    kept = thin_out(np.vstack((near, far)))
    assert (kept[:, 0] == 0.5).sum() <= 4
    assert (kept[:, 0] == 5.0).sum() == 20
    assert len(thin_out(np.vstack((near, far)), most=10)) <= 10


def test_starts_are_the_best_that_lie_apart():
    poses = np.array([[0.0, 0.0, 0.0], [0.01, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert apart(poses, np.array([3.0, 4.0, 1.0, 2.0]), 3, 0.1, 0.1) == [1, 3, 2]


def test_no_two_starts_are_one_place_and_none_that_stands_alone_is_left_out():
    rng = np.random.default_rng(4)
    poses, values = rng.uniform(-1.0, 1.0, (300, 3)) * (1.0, 1.0, 4.0), rng.random(300)
    chosen = apart(poses, values, 300, 0.3, 0.4)

    def is_near(one, other):
        turned = abs(float(normalize_angles(poses[one, 2] - poses[other, 2])))
        return np.hypot(*(poses[one, :2] - poses[other, :2])) <= 0.3 and turned <= 0.4

    assert not any(is_near(one, other) for one in chosen for other in chosen if one != other)
    for left in set(range(300)) - set(chosen):
        assert any(is_near(left, one) and values[one] > values[left] for one in chosen)
    assert apart(poses, values, 10, 0.3, 0.4) == chosen[:10]


def test_one_doubts_when_much_less_is_explained_than_usual():
    doubt = Doubt()
    assert not any(doubt.update(share, 0.5, 0.9) for share in (0.8, 0.75, 0.85, 0.7))
    assert doubt.update(0.4, 0.5, 0.9) and doubt.update(0.4, 0.5, 0.9)
    assert doubt.way == 1.0
    assert not doubt.update(0.8, 0.5, 0.9)
    assert doubt.way == 0.5
    assert doubt.update(0.8, 0.5, 0.01), "what speaks against the pose is not cleared by one scan that fits"


@pytest.mark.parametrize("building, seed", [("hall", 0), ("hall", 1), ("corridors", 0), ("office", 1)])
def test_rough_drives_are_tracked(building, seed):
    """Scans 0.75 m apart, odometry off by 12 %, slips, 15 % of the walls not on the map, people in view."""
    made = make_drive(building, 120, Rough(), np.random.default_rng(seed))
    start = Pose2D(*map(float, made.log.reference[0]))
    result = replay(
        made.log, made.occupancy, LocalizerParameters(), np.random.default_rng(seed), start, np.diag([0.05, 0.05, 0.02])
    )
    off = errors(result.poses, made.log.reference)["translation"]
    assert np.median(off) < 0.1
    assert (off < 1.0).mean() > 0.95
    assert off[-10:].max() < 0.3


def test_robust_off_is_the_plain_filter():
    """The same drive that is kept above is lost without looking at the scan first: the switch does switch."""
    made = make_drive("hall", 120, Rough(), np.random.default_rng(0))
    start = Pose2D(*map(float, made.log.reference[0]))
    result = replay(
        made.log,
        made.occupancy,
        LocalizerParameters(robust=False),
        np.random.default_rng(0),
        start,
        np.diag([0.05, 0.05, 0.02]),
    )
    assert np.median(errors(result.poses, made.log.reference)["translation"]) > 0.1


def test_a_beam_that_ends_on_the_rim_of_the_map_is_not_measured_by_what_lies_on_its_other_side():
    data = np.zeros((20, 20), dtype=np.int8)
    data[:, 0] = 100
    field = DistanceField(OccupancyMap(data, 0.1, IDENTITY), 2.0)
    for end, explained in (((1.9, 1.0), 0.5), ((1.97, 1.0), 0.0), ((1.0, 1.97), 0.0), ((0.03, 1.0), 0.0)):
        beam = np.array([end]) - (0.5, 0.5)
        told = linearize(
            np.array([0.5, 0.5, 0.0]), beam, field.codes, field.face_distances, field.frame, 9.0, 0.1, np.empty((3, 3)),
            np.empty(3))
        assert told > explained if explained else told == 0.0
