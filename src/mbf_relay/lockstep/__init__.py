"""The whole stack in one process on one simulated clock, without ROS: reproducible by its seed, as fast as possible.

    from mbf_relay.lockstep import Episode, circle, config_folder, make_setup

    result = Episode(circle(), make_setup(config_folder()), seed=1).run()

The names are imported on first use, so that results can be read without the physics engine.
"""

import os
from importlib import import_module
from typing import Any

# Before NumPy is imported: OpenBLAS' threads waste time on small matrices, and sum in an order that varies.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
_HOMES = {  # module of each name
    "Episode": "episode", "EpisodeResult": "result", "Task": "tasks", "circle": "tasks", "load_tasks": "tasks",
    "make_setup": "setup", "config_folder": "settings",
}


def __getattr__(name: str) -> Any:
    if name in _HOMES:
        return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
