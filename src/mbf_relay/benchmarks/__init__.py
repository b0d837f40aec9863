"""Every figure the package states about itself, one module per part of it, each with `figures(quick) -> Iterator[Figure]`."""

NAMES = ("simulation", "localization", "costmap", "planning", "control", "server", "relay", "circle", "worlds")
"""The benchmarks, in the order in which they run; each is the module of that name beside this file."""
