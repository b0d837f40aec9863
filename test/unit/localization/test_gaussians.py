"""Distributions over poses and the loops over particles, against plain NumPy, which takes sums in another order."""

import math

import numpy as np
import pytest
from synthetic_room import room

from mbf_relay.geometry import normalize_angles
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.estimate import mean_and_covariance
from mbf_relay.localization.gaussian_kernels import factorize
from mbf_relay.localization.gaussians import (
    FLOOR,
    LEAST,
    PoseGaussian,
    PoseMixture,
    PoseSample,
    log_sum_exp,
    normalized,
)
from mbf_relay.localization.laser_kernels import judge_beams, judge_scan, look_up_endpoints, trace_endpoints
from mbf_relay.localization.scan_likelihood import SPACING, thin_out


class Repeated:
    """A generator whose draws can be asked for a second time."""

    def __init__(self, seed):
        self._rng, self.drawn = np.random.default_rng(seed), []

    def __getattr__(self, name):
        def draw(*arguments):
            self.drawn.append(getattr(self._rng, name)(*arguments))
            return self.drawn[-1].copy()
        return draw


def particles(count, spread, rng):
    """Return poses whose headings lie to both sides of the turn from pi to -pi, and log-weights."""
    poses = np.array([2.0, -1.0, 3.1]) + spread * rng.standard_normal((count, 3))
    poses[:, 2] = normalize_angles(poses[:, 2])
    return poses, np.log(rng.random(count)) - 3.0


def differences(poses, mean):
    return np.column_stack((poses[:, :2] - mean[:2], normalize_angles(poses[:, 2] - mean[2])))


@pytest.mark.parametrize("spread", [0.0, 0.003, 0.3])
def test_particles_are_fitted_and_spread_to_the_floor(spread):
    poses, log_weights = particles(400, spread, np.random.default_rng(1))
    rng = Repeated(2)
    sample = PoseSample(poses, log_weights, rng)
    weights = np.exp(log_weights - log_sum_exp(log_weights))
    fitted = PoseGaussian.fitted(poses, weights)
    missing = np.maximum(FLOOR ** 2 - np.diag(fitted.covariance), LEAST * FLOOR ** 2)
    assert sample.prior.mean == pytest.approx(fitted.mean, abs=1e-12)
    assert sample.prior.covariance == pytest.approx(fitted.covariance + np.diag(missing), abs=1e-12)
    assert sample.poses == pytest.approx(poses + np.sqrt(missing) * rng.drawn[0], abs=1e-12)
    assert np.array_equal(sample.log_weights, log_weights)


def test_what_is_drawn_anew_and_what_stays_are_weighed_as_one_sample_of_the_prior():
    poses, log_weights = particles(300, 0.2, np.random.default_rng(3))
    rng = Repeated(4)
    sample = PoseSample(poses, log_weights, rng)
    before, prior = sample.poses.copy(), sample.prior
    parts = [PoseGaussian(prior.mean + shift, prior.covariance * scale) for shift, scale in ((0.1, 0.5), (-0.2, 0.8))]
    around = PoseMixture(tuple(parts), np.array([0.7, 0.3]))
    sample.redraw(0.4, around, rng)

    _, uniform, noise, counts = rng.drawn
    drawn = uniform < 0.4
    expected = before.copy()
    roots = np.repeat([np.linalg.cholesky(part.covariance) for part in parts], counts, axis=0)
    expected[drawn] = np.repeat([part.mean for part in parts], counts, axis=0) + np.einsum("nij,nj->ni", roots, noise)
    expected[:, 2][drawn] = normalize_angles(expected[:, 2][drawn])
    assert 50 < drawn.sum() < 250
    assert sample.poses == pytest.approx(expected, abs=1e-12)

    share, total = drawn.mean(), log_sum_exp(log_weights)
    of_prior = prior.log_density(expected)
    of_both = np.logaddexp(math.log(1.0 - share) + of_prior, math.log(share) + around.log_density(expected))
    own = np.where(
        drawn, -math.log(len(poses)), math.log(1.0 - share) + log_weights - log_sum_exp(log_weights[~drawn])
    )
    assert sample.log_weights == pytest.approx(total + of_prior - of_both + own, abs=1e-9)


@pytest.mark.parametrize("share", [0.0, 1e-12, 2.0])
def test_where_none_or_all_would_be_drawn_anew_all_stay(share):
    poses, log_weights = particles(20, 0.2, np.random.default_rng(3))
    sample = PoseSample(poses, log_weights, np.random.default_rng(1))
    before = sample.poses.copy()
    sample.redraw(share, PoseMixture((sample.prior,), np.ones(1)), np.random.default_rng(2))
    assert np.array_equal(sample.poses, before)
    assert np.array_equal(sample.log_weights, log_weights)


def test_covariances_are_taken_apart_into_their_roots():
    rng = np.random.default_rng(5)
    matrices = rng.normal(size=(10, 3, 3))
    covariances = matrices @ matrices.transpose(0, 2, 1) + 0.01 * np.eye(3)
    roots, whitening, log_roots = np.empty((10, 3, 3)), np.empty((10, 3, 3)), np.empty(10)
    assert factorize(covariances, roots, whitening, log_roots)
    assert roots == pytest.approx(np.linalg.cholesky(covariances), abs=1e-12)
    assert whitening == pytest.approx(np.linalg.inv(roots), abs=1e-9)
    assert log_roots == pytest.approx(0.5 * np.linalg.slogdet(covariances)[1], abs=1e-9)
    with pytest.raises(np.linalg.LinAlgError, match="positive definite"):
        PoseGaussian(np.zeros(3), np.diag([1.0, -1.0, 1.0])).log_density(np.zeros((1, 3)))


def test_weights_are_normalised_where_their_logarithms_are_far_below_what_a_float_holds():
    logs, weights, log_sum = normalized(np.array([-5000.0, -5001.0, -np.inf]))
    assert weights == pytest.approx(np.array([math.e, 1.0, 0.0]) / (math.e + 1.0))
    assert np.exp(logs) == pytest.approx(weights)
    assert log_sum == pytest.approx(-5000.0 + math.log1p(math.exp(-1.0)))


def test_a_scan_keeps_the_first_of_its_ends_in_each_square():
    points = np.random.default_rng(6).uniform(-3.0, 3.0, (2000, 2))
    points[:20] = [[-0.05, 0.05], [0.05, -0.05]] * 10
    seen, expected = set(), []
    for index, square in enumerate(map(tuple, np.floor(points / SPACING).astype(int))):
        if square not in seen:
            seen.add(square)
            expected.append(index)
    assert np.array_equal(thin_out(points), points[expected])
    assert np.array_equal(thin_out(points, 50), points[expected][:: -(-len(expected) // 50)])
    assert len(thin_out(points[:0])) == 0


@pytest.mark.parametrize("unmapped", [0.1, 0.5])
def test_beams_are_judged_at_the_price_that_the_pose_held_has_for_what_is_not_on_the_map(unmapped):
    rng = np.random.default_rng(7)
    hits, passed = rng.random((3, 40)).astype(np.float32), (rng.random((3, 40)) < 0.3).astype(np.uint8)
    logs, hit, through, grazed = np.empty((4, 3))
    judge_beams(hits, passed, unmapped, 0.45, 0.1, logs, hit, through, grazed)
    wrong = passed * (1.0 - hits.astype(float))
    price = min(max(unmapped, 1.0 - hits[0].mean()), 0.45)
    expected = np.log((1.0 - price) * hits + price * (1.0 - 0.9 * wrong))
    assert logs == pytest.approx(expected.mean(axis=1), abs=1e-6)
    assert hit == pytest.approx(hits.mean(axis=1), abs=1e-6)
    assert through == pytest.approx(wrong.mean(axis=1), abs=1e-6)
    assert grazed == pytest.approx((passed * hits.astype(float)).mean(axis=1), abs=1e-6)


@pytest.mark.parametrize("silent", [0, 7])
def test_a_scan_is_judged_by_its_ends_and_by_its_silent_beams(silent):
    rng, field = np.random.default_rng(9), DistanceField(room(), 2.0)
    poses, ends = rng.normal(0.0, 0.5, (4, 3)), rng.uniform(-4.0, 4.0, (40, 2))
    passed, laser = rng.uniform(-9.0, 9.0, (silent, 2)), np.array([0.1, -0.05])
    fits = np.exp(-field.face_distances)
    judged = np.empty((5, 4))
    judge_scan(
        poses, ends, passed, laser, field.codes, fits, field.cell_distances, field.frame, 0.3, 0.2, 0.45, 0.1, judged)

    hits, through = np.empty((4, 40), np.float32), np.empty((4, 40), np.uint8)
    look_up_endpoints(poses, ends, field.codes, fits, 0.0, field.frame, hits)
    trace_endpoints(poses, ends, laser, field.codes, field.cell_distances, field.frame, 0.3, through)
    expected = np.zeros((5, 4))
    judge_beams(hits, through, 0.2, 0.45, 0.1, *expected[:4])
    if silent:
        crossed = np.empty((4, silent), np.uint8)
        trace_endpoints(poses, passed, laser, field.codes, field.cell_distances, field.frame, 0.3, crossed)
        expected[4] = crossed.mean(axis=1)
        assert 0.0 < expected[4].mean() < 1.0
    assert np.array_equal(judged, expected)


@pytest.mark.parametrize("spread", [0.1, 3.0])
def test_headings_are_averaged_on_their_circle_however_far_they_lie_apart(spread):
    rng = np.random.default_rng(8)
    poses, weights = np.zeros((500, 3)), rng.random(500)
    poses[:, 2] = normalize_angles(rng.uniform(3.1 - spread, 3.1 + spread, 500))
    turned = weights @ np.exp(1j * poses[:, 2]) / weights.sum()
    pose, covariance = mean_and_covariance(poses, weights)
    assert pose.theta == pytest.approx(np.angle(turned), abs=1e-12)
    assert covariance[2, 2] == pytest.approx(-2.0 * math.log(abs(turned)), abs=1e-12)


def test_a_robot_is_not_lost_for_good_where_all_that_stays_of_a_cluster_weighs_next_to_nothing():
    """Its weights were not a number from then on, and every scan after that ended in an error."""
    for seed in range(20):
        poses, _ = particles(8, 0.02, np.random.default_rng(seed))
        log_weights = np.concatenate(([-3.0], np.full(7, -900.0)))
        rng = Repeated(seed)
        sample = PoseSample(poses, log_weights, rng)
        sample.redraw(0.5, PoseMixture((sample.prior,), np.ones(1)), rng)
        assert np.isfinite(sample.log_weights).all()
        drawn = next(draw for draw in rng.drawn if draw.shape == (8,)) < 0.5
        if 0 < drawn.sum() < len(drawn):
            assert log_sum_exp(sample.log_weights[~drawn]) == pytest.approx(-3.0 + math.log((~drawn).mean()), abs=1e-9)
