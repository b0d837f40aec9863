"""Laser models: the likelihood of a scan at each particle's pose (chapter 6).

Each returns a log-likelihood up to a constant, since products of many beams would underflow.
"""

from __future__ import annotations

import abc
from typing import Callable, Dict, Optional, Tuple

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.beams import Beams, pick_beams, step_between
from mbf_relay.localization.distance_field import DistanceField
from mbf_relay.localization.laser_kernels import look_up_endpoints, sum_over_endpoints, sum_over_rays
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.scan_likelihood import temper
from mbf_relay.scan import LaserScan

CONVERGED_WITHIN = 0.5
"""Half side (m) of the square around their mean that holds all particles once amcl calls the filter converged."""


class LaserModel(abc.ABC):
    """Computes likelihoods of scans on one map.

    Attributes:
        rounds_step_up: Whether the step between beams is rounded up; see `step_between`.
    """

    rounds_step_up = False

    def __init__(self, field: DistanceField, parameters: LocalizerParameters) -> None:
        self.field = field
        self.parameters = parameters

    def pick(self, scan: LaserScan, laser_pose: Pose2D) -> Beams:
        """Return the beams of a scan that the model uses; ValueError as of `limits_of`."""
        values = self.parameters
        step = step_between(len(scan.ranges), values.laser_max_beams, self.rounds_step_up)
        return pick_beams(scan, laser_pose, step, values.laser_min_range, values.laser_max_range)

    @abc.abstractmethod
    def log_likelihoods(self, poses: np.ndarray, beams: Beams, converged: bool = False) -> np.ndarray:
        """Return the log-likelihood of the beams at each pose.

        Args:
            poses: Shape (N, 3), in the map's frame.
            beams: Of one scan.
            converged: Whether the particles were close together (`is_converged`) when they were last resampled.

        Returns:
            Shape (N,).
        """

    def tempered(self, poses: np.ndarray, beams: Beams, converged: bool = False) -> np.ndarray:
        """Return the log-likelihood scaled to a few independent beams, for the robust form; arguments as above.

        Models that add cubes have no product over beams. Their log-likelihood is taken for three times the log of the
        beams' power mean, and scaled to the number of beams by that.
        """
        count = len(beams.ranges)
        return self.log_likelihoods(poses, beams, converged) * (count * temper(count) / 3.0)


class BeamModel(LaserModel):
    """Readings against ranges cast through the map: hit, short, max, random (table 6.1).

    As in amcl the terms of the beams are cubed and added, not multiplied, which keeps dependent beams from agreeing
    too strongly: p = 1 + sum of pz^3.
    """

    def log_likelihoods(self, poses: np.ndarray, beams: Beams, converged: bool = False) -> np.ndarray:
        values = self.parameters
        model = np.array([
            values.laser_z_hit, values.laser_z_short, values.laser_z_max, values.laser_z_rand,
            values.laser_sigma_hit, values.laser_lambda_short,
        ])
        sums = np.empty(len(poses))
        laser = np.array([beams.laser_pose.x, beams.laser_pose.y])
        sum_over_rays(
            poses,
            beams.ranges,
            beams.bearings,
            laser,
            self.field.blocked,
            self.field.frame,
            beams.range_max,
            model,
            sums,
        )
        return np.log1p(sums)


class FieldModel(LaserModel):
    """Base of the models that look endpoints up in a table of terms, recomputed where the maximum range changes."""

    def __init__(self, field: DistanceField, parameters: LocalizerParameters) -> None:
        super().__init__(field, parameters)
        self._table: Optional[np.ndarray] = None
        self._table_key: Tuple[float, ...] = ()
        self._outside = 0.0

    def table(self, range_max: float) -> Tuple[np.ndarray, float]:
        """Return a beam's term for each code of the cell it ends in, float32 (65536,), and for an end off the map."""
        if self._table is None or self._table_key != (range_max,):
            self._table = self.term(self.hit_likelihood(self.field.cell_distances, range_max))
            self._outside = float(
                self.term(self.hit_likelihood(np.array(self.field.max_distance, np.float32), range_max))
            )
            self._table_key = (range_max,)
        return self._table, self._outside

    def hit_likelihood(self, distances: np.ndarray, range_max: float) -> np.ndarray:
        """Return z_hit exp(-d^2 / 2 sigma^2) + z_rand / range_max for distances (m), float32 (table 6.3)."""
        values = self.parameters
        scale = np.float32(-0.5 / values.laser_sigma_hit ** 2)
        hits = np.exp(np.square(distances) * scale) * np.float32(values.laser_z_hit)
        likelihood: np.ndarray = hits + np.float32(values.laser_z_rand / range_max)
        return likelihood

    @abc.abstractmethod
    def term(self, likelihood: np.ndarray) -> np.ndarray:
        """Return the terms of the sum for beams of these likelihoods, of the same shape."""


class LikelihoodFieldModel(FieldModel):
    """Endpoints on the distance field (table 6.3), cubed and added as in amcl: p = 1 + sum of pz^3."""

    def term(self, likelihood: np.ndarray) -> np.ndarray:
        cubes: np.ndarray = likelihood * likelihood * likelihood
        return cubes

    def log_likelihoods(self, poses: np.ndarray, beams: Beams, converged: bool = False) -> np.ndarray:
        sums = np.empty(len(poses))
        table, outside = self.table(beams.range_max)
        sum_over_endpoints(poses, beams.hits, self.field.codes, table, outside, self.field.frame, sums)
        return np.log1p(sums)


class LikelihoodFieldProbModel(FieldModel):
    """Endpoints on the distance field (table 6.3): the product of the likelihoods, with amcl's beam skipping."""

    rounds_step_up = True

    def term(self, likelihood: np.ndarray) -> np.ndarray:
        logs: np.ndarray = np.log(np.maximum(likelihood, np.float32(1e-30)))
        return logs

    def log_likelihoods(self, poses: np.ndarray, beams: Beams, converged: bool = False) -> np.ndarray:
        hits = beams.hits
        table, outside = self.table(beams.range_max)
        if self.parameters.do_beamskip and converged:
            hits = np.ascontiguousarray(hits[self.beams_to_keep(poses, hits)])
        sums = np.empty(len(poses))
        sum_over_endpoints(poses, hits, self.field.codes, table, outside, self.field.frame, sums)
        return sums

    def tempered(self, poses: np.ndarray, beams: Beams, converged: bool = False) -> np.ndarray:
        return self.log_likelihoods(poses, beams, converged) * temper(len(beams.hits))

    def beams_to_keep(self, poses: np.ndarray, hits: np.ndarray) -> np.ndarray:
        """Return which beams are not skipped, bool of shape (H,).

        A beam whose end is far from any obstacle for most particles hit something that is not mapped, e.g. a person,
        and is skipped. Where nearly all would be, the particles are wrong rather than the map, and none is.

        Args:
            poses: Particles, shape (N, 3), in the map's frame.
            hits: Ends of the beams (m), shape (H, 2), in the base's frame.
        """
        values = self.parameters
        distances = np.empty((len(poses), len(hits)), dtype=np.float32)
        field = self.field
        look_up_endpoints(poses, hits, field.codes, field.cell_distances, np.inf, field.frame, distances)
        explained: np.ndarray = (distances < values.beam_skip_distance).mean(axis=0) > values.beam_skip_threshold
        if np.count_nonzero(~explained) >= values.beam_skip_error_threshold * len(hits):
            return np.ones(len(hits), dtype=bool)
        return explained


def is_converged(poses: np.ndarray) -> bool:
    """Return whether all particles lie within CONVERGED_WITHIN of their mean in x and in y, as amcl does."""
    axes = poses[:, 0], poses[:, 1]
    return all(max(axis.max() - axis.mean(), axis.mean() - axis.min()) <= CONVERGED_WITHIN for axis in axes)


MODELS: Dict[str, Callable[[DistanceField, LocalizerParameters], LaserModel]] = {
    "beam": BeamModel,
    "likelihood_field": LikelihoodFieldModel,
    "likelihood_field_prob": LikelihoodFieldProbModel,
}


def make_laser_model(field: DistanceField, parameters: LocalizerParameters) -> LaserModel:
    """Return the laser model the parameters name."""
    return MODELS[parameters.laser_model_type](field, parameters)
