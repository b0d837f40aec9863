"""Command line options common to the batch and tune commands."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import List, Sequence

from mbf_relay.commands import positive
from mbf_relay.lockstep.settings import config_folder
from mbf_relay.lockstep.setup import LOCALIZATIONS, MAPS, Setup, make_setup
from mbf_relay.lockstep.tasks import MAP_RESOLUTION, EpisodeTask, have_maps

TIME_LIMIT = 900.0
"""Seconds of CPU time after which an episode counts as hung; a circle takes one to five."""


def add_setup_options(parser: argparse.ArgumentParser) -> None:
    """Add the options on how episodes are driven."""
    parser.add_argument(
        "--localization", choices=LOCALIZATIONS,
        help="source of the robot's pose; truth is the simulator's (default amcl; odometry without a map)",
    )
    parser.add_argument(
        "--map",
        choices=MAPS,
        help="known: the robot starts with a map of the world (default; none for a worlds file without maps)",
    )
    parser.add_argument(
        "--map-resolution", type=float, default=MAP_RESOLUTION, metavar="M",
        help="side of a cell, in metres, in maps drawn from worlds (default %(default)s)",
    )
    parser.add_argument(
        "--controller", default="", metavar="NAME", help="controller of move_base_flex.yaml (default: its first)"
    )
    parser.add_argument(
        "--planner", default="", metavar="NAME", help="planner of move_base_flex.yaml (default: its first)")
    parser.add_argument(
        "--robot", default="", metavar="ROBOT",
        help="the robot: a file in config/robot without its ending, or a .yaml or .urdf file; parameters fit it",
    )
    parser.add_argument(
        "--scale", type=float, default=1.0, metavar="S", help="make the worlds S times as large, for a larger robot"
    )
    parser.add_argument(
        "--after-contact", action="store_true",
        help="drive on after a collision and count contacts; the drive counts as failed all the same",
    )
    parser.add_argument(
        "--config", type=Path, metavar="FILE",
        help="your own parameters, which override the package's: a file named like a node's (move_base_flex.yaml), a "
        "file with parameters by node, or a folder of such files",
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="A.B=C",
        help="set a parameter of the nodes' files; may be repeated",
    )


def setup_of(options: argparse.Namespace, tasks: Sequence[EpisodeTask], changes: Sequence[str] = ()) -> Setup:
    """Return the setup by the options of `add_setup_options`.

    Args:
        options: The parsed options.
        tasks: The worlds to drive.
        changes: Further changes "a.b=c", applied after those of the options.

    Raises:
        ValueError: See `make_setup` and `have_maps`.
    """
    return make_setup(
        config_folder(), options.localization, options.map, options.controller, options.planner,
        [*options.set, *changes], have_maps(tasks, bool(options.map)), options.config, options.map_resolution,
        options.robot, options.after_contact, tasks)


def add_worker_options(parser: argparse.ArgumentParser) -> None:
    """Add the options on processes and cluster."""
    parser.add_argument(
        "--jobs", type=positive, default=os.cpu_count() or 1, metavar="N",
        help="processes on this machine (default: number of cores); 1 works in this process",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--scheduler", default="", metavar="tcp://HOST:PORT", help="run on this Dask cluster instead")
    where.add_argument(
        "--scheduler-file", type=Path, metavar="FILE", help="the same, with the file Dask's scheduler writes")
    parser.add_argument(
        "--time-limit", type=_above_zero, default=TIME_LIMIT, metavar="S",
        help=f"computing time in seconds after which an episode counts as hung (default {TIME_LIMIT:g})",
    )


def seeds(text: str) -> List[int]:
    """Return the seeds of "N" (1 to N) or "A-B"."""
    first, dash, last = text.partition("-")
    try:
        low, high = (int(first), int(last)) if dash else (1, int(text))
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' must be a number, or a range such as 10-19") from None
    if low < 0 or high < max(low, 1):
        raise argparse.ArgumentTypeError(f"'{text}' holds no seed")
    return list(range(low, high + 1))


def share(text: str) -> float:
    """Return the fraction, 0 to 1, that a text states."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise argparse.ArgumentTypeError(f"'{text}' is no share; it must be 0 to 1")
    return value


def _above_zero(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not value > 0.0:
        raise argparse.ArgumentTypeError(f"'{text}' is no number above 0")
    return value
