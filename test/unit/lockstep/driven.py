"""Drives that several tests look at, each driven once."""

import functools

from mbf_relay.lockstep.episode import Episode
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import make_setup
from mbf_relay.lockstep.tasks import circle


@functools.lru_cache(maxsize=None)
def circle_by_amcl():
    """Return what came of the circle by the package's own parameters, with seed 1."""
    return Episode(circle(), make_setup(config_folder()), seed=1).run()
