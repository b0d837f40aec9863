"""Every metric the package states about itself, one module per part of it with `metrics(quick) -> Iterator[Metric]`."""

NAMES = (
    "yardstick",
    "simulation",
    "localization",
    "map_gaps",
    "costmap",
    "planning",
    "control",
    "server",
    "relay",
    "guard",
    "one_process",
    "footprint",
    "circle",
    "late_commands",
    "worlds",
    "zoo",
    "cluster",
    "environment",
    "web",
    "reliability",
)
"""The benchmarks, in the order in which they run; each is the module of that name beside this file."""
ONLY_BY_NAME = ("map_gaps", "reliability")
"""Those that take an hour, and run where they are asked for."""
