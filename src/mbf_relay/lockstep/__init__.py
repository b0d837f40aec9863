"""The whole stack in one process on one clock, without ROS: one seed gives one drive, as fast as the processor goes.

    from mbf_relay.lockstep import Episode, circle, config_folder, make_setup

    result = Episode(circle(), make_setup(config_folder()), seed=1).run()

The names are loaded when they are first asked for, so that results can be read without physics.
"""

import os
from importlib import import_module
from typing import Any

# Before NumPy is imported: OpenBLAS's threads spin between small matrices, and add up in an order of their own.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
_HOMES = {
    "Episode": "episode", "EpisodeResult": "result", "Task": "tasks", "circle": "tasks", "load_tasks": "tasks",
    "make_setup": "setup", "config_folder": "settings",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
