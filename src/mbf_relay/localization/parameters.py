"""Parameters of the particle filter, by amcl's names and with its defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Tuple

from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class LocalizerParameters(ParameterSet):
    """What the filter, its laser model and its motion model are set to."""

    min_particles: int = parameter(100, "smallest number of particles", minimum=1, maximum=1000000)
    max_particles: int = parameter(5000, "largest number of particles", minimum=1, maximum=1000000)
    kld_err: float = parameter(
        0.01, "largest error between the true and the estimated distribution (KLD sampling)", above=0.0, maximum=1.0)
    kld_z: float = parameter(
        0.99, "upper standard normal quantile for the probability that this error stays below kld_err", minimum=0.0)
    update_min_d: float = parameter(
        0.2, "distance the robot must move before the filter is updated", unit="m", minimum=0.0)
    update_min_a: float = parameter(
        math.pi / 6.0, "angle the robot must turn before the filter is updated", unit="rad", minimum=0.0)
    resample_interval: int = parameter(2, "number of updates between two resamplings", minimum=1)
    selective_resampling: bool = parameter(False, "resample only if fewer than half of the particles are effective")
    recovery_alpha_slow: float = parameter(
        0.0, "decay rate of the slow average of the weights, by which random poses are added; 0 adds none, 0.001 is a "
        "good value", minimum=0.0, maximum=1.0)
    recovery_alpha_fast: float = parameter(
        0.0, "decay rate of the fast average of the weights, by which random poses are added; 0 adds none, 0.1 is a "
        "good value", minimum=0.0, maximum=1.0)

    laser_min_range: float = parameter(-1.0, "shorter readings are ignored; -1 for the scan's range_min", unit="m")
    laser_max_range: float = parameter(-1.0, "longer readings are ignored; -1 for the scan's range_max", unit="m")
    laser_max_beams: int = parameter(30, "number of evenly spaced beams used of each scan", minimum=2)
    laser_z_hit: float = parameter(0.95, "weight of readings that hit what is on the map", minimum=0.0)
    laser_z_short: float = parameter(0.1, "weight of readings shorter than the map says (beam model)", minimum=0.0)
    laser_z_max: float = parameter(0.05, "weight of readings without a return (beam model)", minimum=0.0)
    laser_z_rand: float = parameter(0.05, "weight of random readings", minimum=0.0)
    laser_sigma_hit: float = parameter(
        0.2, "standard deviation of readings that hit what is on the map", unit="m", minimum=0.001)
    laser_lambda_short: float = parameter(
        0.1, "exponential decay rate of short readings (beam model)", unit="1/m", minimum=0.0)
    laser_likelihood_max_dist: float = parameter(
        2.0, "largest distance to the nearest obstacle on the map; farther counts as this far", unit="m", above=0.0)
    laser_model_type: str = parameter(
        "likelihood_field", "model by which particles are weighted with a scan",
        choices=("beam", "likelihood_field", "likelihood_field_prob"), else_default=True)
    do_beamskip: bool = parameter(False, "ignore beams that match the map for few particles (likelihood_field_prob)")
    beam_skip_distance: float = parameter(
        0.5, "distance from its end to the nearest obstacle on the map below which a beam matches", unit="m",
        minimum=0.0)
    beam_skip_threshold: float = parameter(
        0.3, "share of the particles for which a beam must match not to be skipped", minimum=0.0, maximum=1.0)
    beam_skip_error_threshold: float = parameter(
        0.9, "if a larger share of the beams than this would be skipped, all are used", minimum=0.0, maximum=1.0,
        aliases=("beam_skip_error_threshold_",))

    robust: bool = parameter(
        True, "keep track with sparse scans, slipping wheels and incomplete maps: particles are drawn with the scan in "
        "view and, with laser_model_type likelihood_field, weighted by all beams (laser_max_beams and laser_z_* are "
        "ignored); false for amcl's behaviour")
    robust_odom_error: float = parameter(
        0.07, "smallest standard deviation assumed of odometry after one metre; grows with the square root of the "
        "distance (robust)", unit="m", minimum=0.0, maximum=1.0)
    changed_block_size: float = parameter(
        1.0, "side of the map's blocks in which changes are counted (robust)", unit="m", minimum=0.25, maximum=100.0)
    semi_static: bool = parameter(
        False, "ignore beams that end in changed blocks of the map (robust); for a map that lacks much of what is "
        "there")
    odom_model_type: str = parameter(
        "diff", "motion model", choices=("diff", "omni", "diff-corrected", "omni-corrected"), else_default=True)
    odom_alpha1: float = parameter(0.2, "noise of the rotation caused by rotation", minimum=0.0)
    odom_alpha2: float = parameter(0.2, "noise of the rotation caused by translation", minimum=0.0)
    odom_alpha3: float = parameter(0.2, "noise of the translation caused by translation", minimum=0.0)
    odom_alpha4: float = parameter(0.2, "noise of the translation caused by rotation", minimum=0.0)
    odom_alpha5: float = parameter(
        0.2, "noise of the sideways translation caused by translation (omni models)", minimum=0.0)

    ORDERED: ClassVar[Tuple[Tuple[str, str], ...]] = (("min_particles", "max_particles"),)
