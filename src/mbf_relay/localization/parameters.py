"""Parameters of the particle filter, by amcl's names and with its defaults."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Tuple

from mbf_relay.parameters import ParameterSet, parameter


@dataclass(frozen=True)
class LocalizerParameters(ParameterSet):
    """What the filter, its laser model and its motion model are set to."""

    min_particles: int = parameter(100, "fewest particles", minimum=1, maximum=1000000)
    max_particles: int = parameter(5000, "most particles", minimum=1, maximum=1000000)
    kld_err: float = parameter(0.01, "largest error between true and estimated distribution", above=0.0, maximum=1.0)
    kld_z: float = parameter(
        0.99, "upper standard normal quantile for the probability that the error stays below kld_err", minimum=0.0
    )
    update_min_d: float = parameter(0.2, "motion that calls for an update", unit="m", minimum=0.0)
    update_min_a: float = parameter(math.pi / 6.0, "turn that calls for an update", unit="rad", minimum=0.0)
    resample_interval: int = parameter(2, "updates from one resampling to the next", minimum=1)
    selective_resampling: bool = parameter(False, "resample only when less than half of the particles are effective")
    recovery_alpha_slow: float = parameter(
        0.0,
        "decay rate of the slow average weight, 0 for no random poses; 0.001 is a good value",
        minimum=0.0,
        maximum=1.0,
    )
    recovery_alpha_fast: float = parameter(
        0.0,
        "decay rate of the fast average weight, 0 for no random poses; 0.1 is a good value",
        minimum=0.0,
        maximum=1.0,
    )

    laser_min_range: float = parameter(-1.0, "shorter readings are left out; -1: as the scan says", unit="m")
    laser_max_range: float = parameter(-1.0, "longer readings are left out; -1: as the scan says", unit="m")
    laser_max_beams: int = parameter(30, "beams of a scan that are used, evenly spread", minimum=2)
    laser_z_hit: float = parameter(0.95, "share of readings that hit what the map holds", minimum=0.0)
    laser_z_short: float = parameter(0.1, "share of readings off something nearer (beam model)", minimum=0.0)
    laser_z_max: float = parameter(0.05, "share of readings without return (beam model)", minimum=0.0)
    laser_z_rand: float = parameter(0.05, "share of readings without a reason", minimum=0.0)
    laser_sigma_hit: float = parameter(0.2, "standard deviation of a hit", unit="m", minimum=0.001)
    laser_lambda_short: float = parameter(0.1, "decay of short readings (beam model)", unit="1/m", minimum=0.0)
    laser_likelihood_max_dist: float = parameter(
        2.0, "distance to the nearest obstacle counts up to here", unit="m", above=0.0
    )
    laser_model_type: str = parameter(
        "likelihood_field", "how a scan is weighed", choices=("beam", "likelihood_field", "likelihood_field_prob"),
        else_default=True,
    )
    do_beamskip: bool = parameter(False, "leave out beams that few particles explain (likelihood_field_prob)")
    beam_skip_distance: float = parameter(
        0.5, "a beam that ends nearer to an obstacle is explained", unit="m", minimum=0.0
    )
    beam_skip_threshold: float = parameter(0.3, "share of particles that must explain a beam", minimum=0.0, maximum=1.0)
    beam_skip_error_threshold: float = parameter(
        0.9, "where this share of beams would be left out, all are used", minimum=0.0, maximum=1.0,
        aliases=("beam_skip_error_threshold_",),
    )

    robust: bool = parameter(
        True,
        "look at the scan before drawing particles; with laser_model_type likelihood_field they are weighed by all "
        "beams, tempered, without laser_max_beams and the laser_z_*; false for amcl's behaviour",
    )
    robust_odom_error: float = parameter(
        0.07, "least deviation of odometry after one metre; it grows with the root of the way (robust)", unit="m",
        minimum=0.0, maximum=1.0,
    )
    changed_block_size: float = parameter(
        1.0, "side of the blocks of the map in which changes are counted (robust)", unit="m", minimum=0.25,
        maximum=100.0,
    )
    semi_static: bool = parameter(
        False, "leave beams that end in changed blocks out when the robot is placed (robust); for maps that lack much"
    )
    odom_model_type: str = parameter(
        "diff", "how odometry errs", choices=("diff", "omni", "diff-corrected", "omni-corrected"),
        else_default=True,
    )
    odom_alpha1: float = parameter(0.2, "rotation error from rotation", minimum=0.0)
    odom_alpha2: float = parameter(0.2, "rotation error from translation", minimum=0.0)
    odom_alpha3: float = parameter(0.2, "translation error from translation", minimum=0.0)
    odom_alpha4: float = parameter(0.2, "translation error from rotation", minimum=0.0)
    odom_alpha5: float = parameter(0.2, "sideways error from translation (omni models)", minimum=0.0)

    ORDERED: ClassVar[Tuple[Tuple[str, str], ...]] = (("min_particles", "max_particles"),)
