"""A picture of a parameter search: the values of its trials, and the importance of each parameter."""

from __future__ import annotations

from pathlib import Path
from typing import Dict, List, Mapping, Sequence, Tuple

import numpy as np

from mbf_relay.whole_files import whole_file

Tried = Tuple[Mapping[str, float], float]
"""A trial's parameters and its value."""


def importances(tried: Sequence[Tried]) -> Dict[str, float]:
    """Return the magnitude of each parameter's rank correlation with the value (Spearman's), the largest first.

    Only monotonic influence counts: a parameter whose optimum lies in the middle of its range looks unimportant.
    """
    if len(tried) < 3:
        return {}
    values = _ranks([value for _, value in tried])
    found = {}
    for name in tried[0][0]:
        ranks = _ranks([parameters[name] for parameters, _ in tried])
        spread = float(np.std(ranks) * np.std(values))
        found[name] = abs(float(np.mean((ranks - ranks.mean()) * (values - values.mean())))) / spread if spread else 0.0
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def best_so_far(values: Sequence[float], better: int) -> np.ndarray:
    """Return the running best of the values, shape (N,).

    Args:
        values: In the order of the search.
        better: 1 where more is better, -1 where less is.
    """
    best: np.ndarray = better * np.maximum.accumulate(better * np.array(values, dtype=float))
    return best


def draw(path: Path, tried: Sequence[Tried], better: int) -> None:
    """Write the picture.

    Args:
        path: PNG.
        tried: In the order of the search.
        better: 1 where more is better, -1 where less is.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (history, bars) = pyplot.subplots(1, 2, figsize=(10.0, 3.6), constrained_layout=True)
    values = [value for _, value in tried]
    history.plot(range(1, len(values) + 1), values, "o", label="trial")
    history.step(range(1, len(values) + 1), best_so_far(values, better), where="post", label="best so far")
    history.set(xlabel="trial that was not given up", ylabel="value")
    history.legend()
    found = importances(tried)
    bars.barh([name.partition(".")[2] for name in found][::-1], list(found.values())[::-1])
    bars.set(xlabel="importance (size of the rank correlation)", xlim=(0.0, 1.0))
    with whole_file(path) as stream:
        figure.savefig(stream, dpi=110, format="png")
    pyplot.close(figure)


def _ranks(values: List[float]) -> np.ndarray:
    """Return the rank of each value, with the mean rank for equal ones, shape (N,)."""
    _, index, counts = np.unique(values, return_inverse=True, return_counts=True)
    ranks: np.ndarray = (np.cumsum(counts) - 0.5 * (counts - 1))[index]
    return ranks
