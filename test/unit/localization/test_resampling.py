import math

import numpy as np
import pytest

from mbf_relay.geometry import normalize_angles
from mbf_relay.localization.estimate import cluster, estimate, mean_and_covariance
from mbf_relay.localization.resampling import AverageLikelihood, particle_limits, resample


def every(count):
    """Return limits that call for `count` particles whatever the bins."""
    return np.full(count + 1, count, dtype=np.int64)


def test_draws_follow_the_weights_without_bias():
    poses = np.column_stack((np.arange(5.0), np.zeros(5), np.zeros(5)))
    weights = np.array([0.5, 0.0, 0.2, 0.05, 0.25])
    counts = np.zeros(5)
    for seed in range(200):
        drawn = resample(poses, weights, every(50), np.random.default_rng(seed))
        assert len(drawn) == 50
        counts += np.bincount(drawn[:, 0].astype(int), minlength=5)
    assert counts[1] == 0
    assert counts / counts.sum() == pytest.approx(weights, abs=0.003)


def test_any_number_of_first_draws_is_spread_evenly():
    """The draws of one set differ from their expectation by a few at most, where independent ones would by sqrt(n)."""
    poses = np.column_stack((np.arange(100.0), np.zeros(100), np.zeros(100)))
    weights = np.full(100, 0.01)
    for count in (100, 437, 2000):
        drawn = resample(poses, weights, every(count), np.random.default_rng(count))
        counts = np.bincount(drawn[:, 0].astype(int), minlength=100)
        assert np.abs(counts - count / 100.0).max() <= 3.0


@pytest.mark.parametrize("scale", [1e-300, 1.0, 1e300])
def test_weights_need_not_be_normalised(scale):
    drawn = resample(
        np.arange(9.0).reshape(3, 3), np.array([0.0, 1.0, 0.0]) * scale, every(10), np.random.default_rng(1)
    )
    assert (drawn == [3.0, 4.0, 5.0]).all()


def test_limits_are_those_of_kld_sampling():
    limits = particle_limits(5000, 100, 0.01, 0.99)
    k = 40
    b = 2.0 / (9.0 * (k - 1))
    assert limits[k] == math.ceil((k - 1) / 0.02 * (1.0 - b + math.sqrt(b) * 0.99) ** 3)
    assert limits[2] == 100 and limits[-1] == 5000
    assert limits[1] == 5000  # as in amcl
    assert particle_limits(5000, 100, 0.01, 0.99, True)[1] == 100
    assert (np.diff(limits[2:]) >= 0).all()


def test_a_wide_belief_takes_more_particles_than_a_narrow_one():
    rng, limits = np.random.default_rng(1), particle_limits(5000, 100, 0.02, 0.99, True)
    narrow = resample(rng.normal(0.1, 0.01, (1000, 3)), np.ones(1000), limits, rng)
    wide = resample(rng.uniform(-3.0, 3.0, (1000, 3)), np.ones(1000), limits, rng)
    assert len(narrow) == 100
    assert len(wide) > 1000


@pytest.mark.parametrize("spread", [0.02, 0.1, 0.4, 2.0])
def test_no_more_are_drawn_than_the_bins_filled_call_for(spread):
    """Beside a plain count of bins, from a robot that is tracked and fills a few to one that may be anywhere."""
    rng, most = np.random.default_rng(4), 3000
    poses, weights = rng.normal((0.02, -0.48, 0.02), (spread, spread, 0.5 * spread), (500, 3)), rng.random(500)
    poses[:, 2] = normalize_angles(poses[:, 2])
    calls_for = np.minimum(40 + 60 * np.arange(most + 1), most)
    drawn = resample(poses, weights, calls_for, rng)
    bins, filled = np.floor((drawn + (0.0, 0.0, math.pi)) / (0.5, 0.5, math.pi / 18.0)).astype(int), set()
    for count, key in enumerate(map(tuple, bins), 1):
        filled.add(key)
        assert (count >= calls_for[len(filled)]) == (count == len(drawn))


def test_the_share_of_random_poses_is_kept():
    drawn = resample(
        np.zeros((100, 3)),
        np.ones(100),
        every(4000),
        np.random.default_rng(1),
        0.25,
        lambda count: np.full((count, 3), 9.0),
    )
    assert (drawn[:, 0] == 9.0).mean() == pytest.approx(0.25, abs=0.03)


def test_doubt_is_one_minus_fast_over_slow_also_where_likelihoods_underflow():
    averages = AverageLikelihood()
    assert averages.random_share() == 0.0
    averages.update(-1000.0, 0.1, 0.5)
    assert averages.random_share() == 0.0
    averages.update(-1000.0 + math.log(0.2), 0.1, 0.5)
    assert averages.random_share() == pytest.approx(1.0 - (0.5 + 0.5 * 0.2) / (0.9 + 0.1 * 0.2))
    averages.update(-900.0, 0.1, 0.5)
    assert averages.random_share() == 0.0
    averages.reset()
    assert averages.random_share() == 0.0


def test_without_alphas_there_is_no_doubt():
    averages = AverageLikelihood()
    for log_average in (-1.0, -50.0, -2000.0):
        averages.update(log_average, 0.0, 0.0)
        assert averages.random_share() == 0.0


def test_the_heaviest_cluster_is_the_estimate_and_the_covariance_is_of_all():
    rng = np.random.default_rng(1)
    poses = np.vstack((rng.normal((0.25, 0.25, 0.1), 0.02, (300, 3)), rng.normal((5.25, 0.25, 1.0), 0.02, (100, 3))))
    weights = np.concatenate((np.full(300, 0.4 / 300), np.full(100, 0.6 / 100)))
    found = estimate(poses, weights)
    assert found.clusters == 2
    assert found.weight == pytest.approx(0.6)
    assert found.pose.x == pytest.approx(5.25, abs=0.01)
    assert found.covariance[0, 0] == pytest.approx(0.6 * 0.4 * 25.0, rel=0.02)


def test_clusters_reach_across_bins_corners_and_the_turn():
    near_turn = np.array([[0.1, 0.1, math.pi - 0.01], [0.1, 0.1, -math.pi + 0.01]])
    assert cluster(near_turn)[1] == 1
    assert cluster(np.array([[0.49, 0.49, 0.1], [0.51, 0.51, 0.1]]))[1] == 1
    assert cluster(np.array([[0.1, 0.1, 0.1], [1.1, 0.1, 0.1]]))[1] == 2
    chain = np.column_stack((np.arange(50) * 0.5 + 0.1, np.zeros(50), np.zeros(50)))
    labels, count = cluster(chain)
    assert count == 1 and (labels == 0).all()


@pytest.mark.parametrize("spread", [0.05, 0.3, 1.0, 4.0])
@pytest.mark.parametrize("heading", [0.02, math.pi])
def test_clusters_are_those_of_bins_that_touch(spread, heading):
    """Beside plain Python, from a robot that is tracked to one that may be anywhere, headings across the turn too."""
    rng = np.random.default_rng(1)
    poses = rng.normal((0.02, -0.48, heading), (spread, spread, 0.5 * spread), (40, 3))
    poses[:, 2] = normalize_angles(poses[:, 2])
    bins = [tuple(key) for key in np.floor((poses + (0.0, 0.0, math.pi)) / (0.5, 0.5, math.pi / 18.0)).astype(int)]

    def touch(one, other):
        turned = (one[2] - other[2]) % 36
        return abs(one[0] - other[0]) <= 1 and abs(one[1] - other[1]) <= 1 and turned in (0, 1, 35)

    expected = list(range(len(bins)))
    for _ in bins:
        expected = [min(expected[j] for j in range(len(bins)) if touch(bins[i], bins[j])) for i in range(len(bins))]
    labels, count = cluster(poses)
    assert count == len(set(expected))
    assert len(set(zip(labels.tolist(), expected))) == count


def test_mean_heading_and_variance_are_circular():
    angles = np.random.default_rng(2).normal(math.pi, 0.1, 20000)
    poses = np.column_stack((np.zeros(20000), np.zeros(20000), angles))
    mean, covariance = mean_and_covariance(poses, np.ones(20000))
    assert abs(abs(mean.theta) - math.pi) < 0.01
    assert covariance[2, 2] == pytest.approx(0.01, rel=0.05)
