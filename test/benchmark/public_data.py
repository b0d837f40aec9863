"""Data of others that some benchmarks are taken on; it is no part of the package."""

from __future__ import annotations

import os
from pathlib import Path

from benchmark.metric import NotMeasurable


def public_data(name: str) -> Path:
    """Return a file or folder of the data that lies beside the checkout, in `shared/data`.

    Args:
        name: Of the file or folder.

    Raises:
        NotMeasurable: It is not there, and $MBF_RELAY_SHARED does not say where else.
    """
    places = [Path(__file__).resolve().parents[2].parent / "shared"]
    if "MBF_RELAY_SHARED" in os.environ:
        places.insert(0, Path(os.environ["MBF_RELAY_SHARED"]))
    for place in places:
        if (place / "data" / name).exists():
            return place / "data" / name
    raise NotMeasurable(f"{name} was not found; set MBF_RELAY_SHARED to the folder that holds data/{name}")
