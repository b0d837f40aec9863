# mypy: allow-untyped-defs, allow-untyped-calls
"""Compiled loops over weighted poses: their moments, and how likely normal distributions make them."""

from __future__ import annotations

import math

import numpy as np

from mbf_relay.kernels import kernel


@kernel("float64(float64[:,::1], float64[::1], float64[::1], float64[:,::1])")
def moments(poses, weights, mean, covariance):
    """Compute the mean and the covariance of weighted poses, the heading's on its circle.

    Args:
        poses: Shape (N, 3).
        weights: Shape (N,), not negative, sum above 0.
        mean: Result, shape (3,).
        covariance: Result, shape (3, 3), of the differences from the mean.

    Returns:
        The length, 0 to 1, of the mean of the headings' unit vectors.
    """
    total, x, y, cos, sin = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(poses.shape[0]):
        weight = weights[i]
        total += weight
        x += weight * poses[i, 0]
        y += weight * poses[i, 1]
        cos += weight * math.cos(poses[i, 2])
        sin += weight * math.sin(poses[i, 2])
    mean[0], mean[1], mean[2] = x / total, y / total, math.atan2(sin, cos)
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
        log_heights: Log-density of each part at its mean, its share in it, shape (K,).
        first: Result, shape (N,): of the first part alone, its share in it.
        logs: Result, shape (N,): of all.
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
            elif log > highest:
                total = 1.0 + total * math.exp(highest - log)
                highest = log
            else:
                total += math.exp(log - highest)
        logs[i] = highest if total == 1.0 else highest + math.log(total)
