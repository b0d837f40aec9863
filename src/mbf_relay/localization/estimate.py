"""The pose estimate: clusters of particles, and their mean and covariance as amcl reports them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.gaussian_kernels import moments
from mbf_relay.localization.resampling_kernels import label_clusters

Moments = Tuple[Pose2D, np.ndarray]
"""Mean and covariance, shape (3, 3) over x, y (m) and theta (rad), of poses."""


@dataclass(frozen=True)
class Estimate:
    """Where the robot is.

    Attributes:
        pose: Of the base, in the map's frame.
        covariance: Shape (3, 3) over x, y (m^2) and theta (rad^2), of all particles.
        weight: Share of the belief, 0 to 1, in the cluster the pose was taken from.
        clusters: Number of separate clusters.
    """

    pose: Pose2D
    covariance: np.ndarray
    weight: float
    clusters: int


def cluster(poses: np.ndarray) -> Tuple[np.ndarray, int]:
    """Return each particle's cluster, shape (N,), and their number; adjacent histogram bins make one cluster."""
    labels = np.empty(len(poses), dtype=np.int64)
    return labels, int(label_clusters(np.ascontiguousarray(poses), labels))


def heaviest_first(labels: np.ndarray, weights: np.ndarray, count: int) -> List[Tuple[int, float]]:
    """Return (cluster, share of the weight), heaviest first."""
    shares = np.bincount(labels, weights, minlength=count)
    return [(int(label), float(shares[label])) for label in np.argsort(-shares, kind="stable")]


def mean_and_covariance(poses: np.ndarray, weights: np.ndarray) -> Moments:
    """Return the weighted mean pose and covariance, shape (3, 3); the heading's is -2 ln R as in amcl."""
    mean, spread, covariance = np.empty(3), np.empty((3, 3)), np.zeros((3, 3))
    length = moments(np.ascontiguousarray(poses), np.ascontiguousarray(weights), mean, spread)
    covariance[:2, :2] = spread[:2, :2]
    covariance[2, 2] = max(0.0, -2.0 * math.log(min(1.0, max(1e-300, length))))
    return Pose2D(*map(float, mean)), covariance


def deviation_of(covariance: np.ndarray) -> float:
    """Return the standard deviation (m) per axis, the mean of x and y, of a pose covariance, shape (3, 3)."""
    return math.sqrt(0.5 * float(covariance[0, 0] + covariance[1, 1]))


def estimate(poses: np.ndarray, weights: np.ndarray, moments_of_all: Optional[Moments] = None) -> Estimate:
    """Return the mean of the heaviest cluster of particles, shape (N, 3), with the covariance of the whole set.

    With several clusters the mean of all particles would lie between them, where the robot is not.

    Args:
        poses: Shape (N, 3).
        weights: Shape (N,).
        moments_of_all: The result of `mean_and_covariance` for them, where it is already known.
    """
    labels, count = cluster(poses)
    pose, covariance = moments_of_all or mean_and_covariance(poses, weights)
    share = 1.0
    if count > 1:
        label, share = heaviest_first(labels, weights, count)[0]
        members = labels == label
        pose, _ = mean_and_covariance(poses[members], weights[members])
    return Estimate(pose, covariance, min(1.0, share), count)
