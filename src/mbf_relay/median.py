"""The median as nodes take it: NumPy's own reads its masked arrays, a MiB for as long as a node lives."""

from __future__ import annotations

from typing import Any

import numpy as np


def median(values: np.ndarray) -> Any:
    """Return the median along the first axis of numbers, shape (N, …), to the last bit as numpy.median has it."""
    ordered = np.sort(values, axis=0)
    return 0.5 * (ordered[(len(values) - 1) // 2] + ordered[len(values) // 2])
