# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over weighted poses: moments, and densities of normal distributions and their mixtures."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel

NARROW = 0.8
"""Largest angle (rad) for which nine terms of the series of cosine and sine are exact to a double's last digit."""
SERIES = np.array([[1.0 / (n * (n - 1)), 1.0 / (n * (n + 1))] for n in range(16, 0, -2)])
"""Ratios of successive terms of the two series, without the squared angle, last ones first (Horner's scheme)."""


@kernel("float64(float64[:,::1], float64[::1], float64[::1], float64[:,::1])")
def moments(poses, weights, mean, covariance):
    """Compute the mean and the covariance of weighted poses, with the circular mean of the headings.

    Args:
        poses: Shape (N, 3).
        weights: Shape (N,), not negative, sum above 0.
        mean: Result, shape (3,).
        covariance: Result, shape (3, 3), of the differences from the mean.

    Returns:
        The length, 0 to 1, of the mean of the headings' unit vectors.
    """
    total, x, y, cos, sin, first, widest = 0.0, 0.0, 0.0, 0.0, 0.0, poses[0, 2], 0.0
    for i in range(poses.shape[0]):
        weight = weights[i]
        total += weight
        x += weight * poses[i, 0]
        y += weight * poses[i, 1]
        turn = poses[i, 2] - first
        if abs(turn) > math.pi:
            turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
        widest = max(widest, abs(turn))
        square = turn * turn
        value, slope = 1.0, 1.0
        for term in range(SERIES.shape[0]):
            value, slope = 1.0 - square * SERIES[term, 0] * value, 1.0 - square * SERIES[term, 1] * slope
        cos += weight * value
        sin += weight * turn * slope
    if not widest < NARROW:
        cos, sin = 0.0, 0.0
        for i in range(poses.shape[0]):
            cos += weights[i] * math.cos(poses[i, 2] - first)
            sin += weights[i] * math.sin(poses[i, 2] - first)
    mean[0], mean[1], mean[2] = x / total, y / total, first + math.atan2(sin, cos)
    if abs(mean[2]) > math.pi:
        mean[2] -= 2.0 * math.pi * math.floor((mean[2] + math.pi) / (2.0 * math.pi))
    xx, xy, xa, yy, ya, aa = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(poses.shape[0]):
        weight = weights[i]
        dx, dy, turn = poses[i, 0] - mean[0], poses[i, 1] - mean[1], poses[i, 2] - mean[2]
        if abs(turn) > math.pi:
            turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
        xx += weight * dx * dx
        xy += weight * dx * dy
        xa += weight * dx * turn
        yy += weight * dy * dy
        ya += weight * dy * turn
        aa += weight * turn * turn
    covariance[0, 0], covariance[1, 1], covariance[2, 2] = xx / total, yy / total, aa / total
    covariance[0, 1], covariance[0, 2], covariance[1, 2] = xy / total, xa / total, ya / total
    covariance[1, 0], covariance[2, 0], covariance[2, 1] = xy / total, xa / total, ya / total
    return math.hypot(cos, sin) / total


@kernel("void(float64[:,::1], float64[:,::1], float64[:,:,::1], float64[::1], float64[::1], float64[::1])")
def log_mixture(poses, means, whitening, log_heights, first, logs):
    """Compute the log-density of a mixture of normal distributions at poses.

    Args:
        poses: Shape (N, 3).
        means: Of the parts, shape (K, 3).
        whitening: Inverse of the lower triangular root of each part's covariance, shape (K, 3, 3).
        log_heights: Log of share times density of each part at its mean, shape (K,).
        first: Result, shape (N,): log of share times density of the first part.
        logs: Result, shape (N,): log-density of the mixture.
    """
    for i in range(poses.shape[0]):
        highest, total = -np.inf, 0.0
        for k in range(means.shape[0]):
            dx, dy, turn = poses[i, 0] - means[k, 0], poses[i, 1] - means[k, 1], poses[i, 2] - means[k, 2]
            if abs(turn) > math.pi:
                turn -= 2.0 * math.pi * math.floor((turn + math.pi) / (2.0 * math.pi))
            u = whitening[k, 0, 0] * dx
            v = whitening[k, 1, 0] * dx + whitening[k, 1, 1] * dy
            w = whitening[k, 2, 0] * dx + whitening[k, 2, 1] * dy + whitening[k, 2, 2] * turn
            log = log_heights[k] - 0.5 * (u * u + v * v + w * w)
            if k == 0:
                highest, total = log, 1.0
                first[i] = log
            else:  # without a branch, which would be mispredicted half the time
                least = math.exp(-abs(log - highest))
                total = 1.0 + total * least if log > highest else total + least
                highest = max(log, highest)
        logs[i] = highest if total == 1.0 else highest + math.log(total)


@kernel("boolean(float64[:,:,::1], float64[:,:,::1], float64[:,:,::1], float64[::1])")
def factorize(covariances, roots, whitening, log_roots):
    """Compute the Cholesky factors of covariances; return whether all of them are positive definite.

    Args:
        covariances: Shape (K, 3, 3), symmetric.
        roots: Result, shape (K, 3, 3), lower triangular: each times its transpose is the covariance.
        whitening: Result, shape (K, 3, 3): the roots' inverses.
        log_roots: Result, shape (K,): logarithms of the roots' determinants.
    """
    for k in range(covariances.shape[0]):
        root, inverse, covariance = roots[k], whitening[k], covariances[k]
        root[:, :] = 0.0
        inverse[:, :] = 0.0
        for j in range(3):
            rest = covariance[j, j]
            for m in range(j):
                rest -= root[j, m] * root[j, m]
            if not rest > 0.0:
                return False
            root[j, j] = math.sqrt(rest)
            for i in range(j + 1, 3):
                rest = covariance[i, j]
                for m in range(j):
                    rest -= root[i, m] * root[j, m]
                root[i, j] = rest / root[j, j]
        for j in range(3):
            inverse[j, j] = 1.0 / root[j, j]
            for i in range(j + 1, 3):
                rest = 0.0
                for m in range(j, i):
                    rest -= root[i, m] * inverse[m, j]
                inverse[i, j] = rest / root[i, i]
        log_roots[k] = math.log(root[0, 0] * root[1, 1] * root[2, 2])
    return True


@kernel("boolean(float64[:,::1], float64[::1], float64[:,::1], float64, float64[::1])")
def log_normal(poses, mean, covariance, log_normalizer, logs):
    """Compute the log-density of a normal distribution at poses; return whether its covariance is positive definite.

    Args:
        poses: Shape (N, 3).
        mean, covariance: Shapes (3,) and (3, 3).
        log_normalizer: Log-density at the mean where the covariance has the determinant 1.
        logs: Result, shape (N,).
    """
    covariances, roots, whitening = covariance.reshape((1, 3, 3)), np.empty((1, 3, 3)), np.empty((1, 3, 3))
    heights, first = np.empty(1), np.empty(poses.shape[0])
    if not factorize(covariances, roots, whitening, heights):
        return False
    heights[0] = log_normalizer - heights[0]
    log_mixture(poses, mean.reshape((1, 3)), whitening, heights, first, logs)
    return True


@kernel("float64(float64[::1], float64[::1])")
def _weigh(log_weights, weights):
    """Fill `weights`, shape (N,), with normalized weights; return the log of the sum of the given ones."""
    highest, total = -np.inf, 0.0
    for i in range(log_weights.shape[0]):
        highest = max(highest, log_weights[i])
    for i in range(log_weights.shape[0]):  # equal ones, as after resampling, need no exp
        weights[i] = 1.0 if log_weights[i] == highest else math.exp(log_weights[i] - highest)
        total += weights[i]
    for i in range(log_weights.shape[0]):
        weights[i] /= total
    return highest + math.log(total)


@kernel(
    "float64(float64[:,::1], float64[::1], float64[:,::1], float64[::1], float64, float64[::1], float64[::1],"
    " float64[:,::1])"
)
def fit_and_spread(poses, log_weights, noise, floor, least, weights, mean, covariance):
    """Fit a normal distribution to weighted poses, and spread them where they are narrower than a floor.

    Args:
        poses: Shape (N, 3).
        log_weights: Shape (N,).
        noise: Standard normal, shape (N, 3); result: the poses with noise added.
        floor: Smallest standard deviations (m, m, rad), shape (3,).
        least: Share of the floor's variance that is always added.
        weights: Result, shape (N,), sum one.
        mean, covariance: Result, shapes (3,) and (3, 3): of the poses that were spread.

    Returns:
        The logarithm of the weights' sum.
    """
    count, log_sum = poses.shape[0], _weigh(log_weights, weights)
    moments(poses, weights, mean, covariance)
    deviations = np.empty(3)
    for j in range(3):
        variance = floor[j] * floor[j]
        missing = max(variance - covariance[j, j], least * variance)
        covariance[j, j] += missing
        deviations[j] = math.sqrt(missing)
    for i in range(count):
        for j in range(3):
            noise[i, j] = poses[i, j] + deviations[j] * noise[i, j]
    return log_sum


@kernel("float64(float64[::1], boolean[::1])")
def _log_sum_of_kept(log_weights, drawn):
    """Return the log of the sum of the weights, (N,), of poses that are not redrawn, without underflow."""
    highest, total = -np.inf, 0.0
    for i in range(log_weights.shape[0]):
        if not drawn[i]:
            highest = max(highest, log_weights[i])
    for i in range(log_weights.shape[0]):
        if not drawn[i]:
            total += math.exp(log_weights[i] - highest)
    return highest + math.log(total)


@kernel(
    "boolean(float64[:,::1], float64[::1], float64[::1], float64, boolean[::1], float64[:,::1], int64[::1],"
    " float64[:,::1], float64[:,:,::1], float64[::1])"
)
def redraw(poses, log_weights, weights, log_total, drawn, noise, counts, means, covariances, log_shares):
    """Redraw some poses from the parts of a mixture after the first; weight all as samples of the first part.

    Return whether all covariances are positive definite; nothing is changed where not.

    Args:
        poses: Shape (N, 3), of the first part; changed.
        log_weights: Shape (N,); changed.
        weights: The same with sum one, shape (N,).
        log_total: Log of the sum of the given weights.
        drawn: Which poses to redraw, bool of shape (N,): some, and not all.
        noise: Standard normal, shape (D, 3), for the D poses to redraw.
        counts: Number of these drawn from each part after the first, shape (K - 1,).
        means, covariances: Of the K parts, shapes (K, 3) and (K, 3, 3).
        log_shares: Log of each part's share, plus LOG_NORMALIZER, shape (K,).
    """
    roots, whitening, log_heights = np.empty_like(covariances), np.empty_like(covariances), np.empty(means.shape[0])
    if not factorize(covariances, roots, whitening, log_heights):
        return False
    for k in range(means.shape[0]):
        log_heights[k] = log_shares[k] - log_heights[k]
    count, kept, part, left, row = poses.shape[0], 0.0, 1, counts[0], 0
    for i in range(count):
        if not drawn[i]:
            kept += weights[i]
            continue
        while left == 0:
            left = counts[part]
            part += 1
        for j in range(3):
            poses[i, j] = means[part, j]
            for m in range(j + 1):
                poses[i, j] += roots[part, j, m] * noise[row, m]
        poses[i, 2] -= 2.0 * math.pi * math.floor((poses[i, 2] + math.pi) / (2.0 * math.pi))
        left -= 1
        row += 1
    first, logs = np.empty(count), np.empty(count)
    log_mixture(poses, means, whitening, log_heights, first, logs)
    share = row / count
    of_first = log_total - math.log(1.0 - share)
    log_kept = log_total + math.log(kept) if kept > 0.0 else _log_sum_of_kept(log_weights, drawn)
    of_kept, of_drawn = math.log(1.0 - share) - log_kept, -math.log(count)
    for i in range(count):
        own = of_drawn if drawn[i] else of_kept + log_weights[i]
        log_weights[i] = of_first + first[i] - logs[i] + own
    return True


@kernel("float64(float64[::1], float64[::1])")
def normalize(log_weights, weights):
    """Normalize log-weights, shape (N,), in place, and fill `weights`; return the log of the former sum."""
    log_sum = _weigh(log_weights, weights)
    for i in range(log_weights.shape[0]):
        log_weights[i] -= log_sum
    return log_sum
