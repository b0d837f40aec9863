"""Drives that several tests look at, each driven once."""

import functools
from pathlib import Path

import small_worlds

from mbf_relay.lockstep.episode import Episode
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import make_setup
from mbf_relay.lockstep.tasks import circle, task_of
from mbf_relay.simulation.worlds_file import world_of


@functools.lru_cache(maxsize=None)
def circle_by_amcl():
    """Return what came of the circle by the package's own parameters, with seed 1."""
    return Episode(circle(), make_setup(config_folder()), seed=1).run()


@functools.lru_cache(maxsize=None)
def bent_by_odometry():
    """Return what came of the way round a cylinder by the package's own parameters, without a map, with seed 1."""
    task = task_of(world_of(Path("worlds.json"), 0, small_worlds.BENT))
    return Episode(task, make_setup(config_folder(), has_map=False), seed=1).run()
