"""Comparison of several batches, each with the first, and plots of success over the worlds' difficulty."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Sequence

import numpy as np

from mbf_relay import statistics
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.summary import Measure, measure_of, paired
from mbf_relay.statistics import IntervalEstimate
from mbf_relay.whole_files import whole_file

SURE = 0.05
"""Significance level: corrected p-values below it count as a difference."""
COMPARED = ("success", "score")
"""Measures that are tested; few, as each further test makes a false positive likelier."""
MOST_GROUPS = 5
"""Most points along the axis of difficulty, each of a group of worlds."""


class Contrast(NamedTuple):
    """The test of one measure of one batch against the first batch.

    Attributes:
        measure: Name of the measure.
        value: Its mean over the batch's episodes of the pairs.
        difference: Mean difference from the first batch.
        chance: p-value, corrected for the number of tests (Holm).
        worlds: Number of worlds compared; each counts once, however many seeds it was driven with.
        needed: Number of worlds with which a significant result is possible at all, at the corrected level.
    """

    measure: str
    value: IntervalEstimate
    difference: IntervalEstimate
    chance: float
    worlds: int
    needed: int = 0

    @property
    def verdict(self) -> str:
        """Return "better", "worse", "no difference" or "too few worlds"."""
        if self.worlds < self.needed:
            return too_few(self.worlds, self.needed)
        if self.chance >= SURE or self.difference.value == 0.0 or math.isnan(self.chance):
            return "no difference"
        return "better" if self.difference.value * measure_of(self.measure).better > 0.0 else "worse"


def too_few(worlds: int, needed: int) -> str:
    """Return the verdict where there are fewer worlds than a significant result needs."""
    return f"too few worlds to tell ({worlds}; it takes {needed})"


def contrasts(
    batches: Sequence[Sequence[EpisodeResult]], compared: Sequence[str] = COMPARED
) -> List[List[Contrast]]:
    """Return the contrasts of each batch but the first, over the episodes that all batches have.

    Args:
        batches: The results of each batch.
        compared: Names of measures, whose `better` must not be 0.

    Raises:
        ValueError: They share no world and seed.
    """
    common = set.intersection(*({(r.world, r.seed) for r in batch} for batch in batches))
    if not common:
        raise ValueError("the batches share no world and seed; drive the same worlds with each")
    shared = [[r for r in batch if (r.world, r.seed) in common] for batch in batches]
    found: List[List[Contrast]] = []
    for batch in shared[1:]:
        found.append([_contrast(measure, shared[0], batch) for measure in map(measure_of, compared)])
    known = [(i, j) for i, row in enumerate(found) for j, one in enumerate(row) if not math.isnan(one.chance)]
    for (i, j), chance in zip(known, statistics.holm([found[i][j].chance for i, j in known])):
        found[i][j] = found[i][j]._replace(chance=chance, needed=statistics.least_groups(SURE / len(known)))
    return found


def _contrast(measure: Measure, first: Sequence[EpisodeResult], other: Sequence[EpisodeResult]) -> Contrast:
    values, differences = paired(measure, first, other)
    if measure.is_share:
        chance = statistics.sign_test({world: [round(d) for d in group] for world, group in differences.items()})
    else:
        chance = statistics.permutation_test(differences) if differences else math.nan
    return Contrast(measure.name, statistics.mean(values), statistics.mean(differences), chance, len(differences))


def as_table(names: Sequence[str], batches: Sequence[Sequence[EpisodeResult]]) -> str:
    """Return the comparison of each batch with the first as a table.

    Args:
        names: Names of the batches.
        batches: Their results.

    Raises:
        ValueError: They share no world and seed.
    """
    rows = contrasts(batches)
    width = max(len(name) for name in names)
    lines = [f"each against {names[0]}, over the episodes all have; intervals 95 %, chances corrected (Holm)"]
    for measure in COMPARED:
        index = COMPARED.index(measure)
        if all(math.isnan(row[index].value.value) for row in rows):
            continue
        lines += ["", f"{measure:{width}}     value   difference"]
        lines += [
            f"{name:{width}} {row[index].value.value:9.3f}   {row[index].difference.value:+9.3f} "
            f"{row[index].difference.interval():24} chance {row[index].chance:.3f}: {row[index].verdict}"
            for name, row in zip(names[1:], rows)
        ]
    return "\n".join(lines)


def by_difficulty(
    results: Iterable[EpisodeResult], difficulties: Mapping[str, Mapping[str, float]], measure: str
) -> List[Any]:
    """Return (mean difficulty, share of successes with interval) of groups of worlds, by rising difficulty.

    Args:
        results: Results of one batch.
        difficulties: Measures of difficulty by world, then by name.
        measure: Name of the measure to use.

    Raises:
        ValueError: No world that was driven has this measure; the text names those there are.
    """
    groups: Dict[str, List[float]] = {}
    for result in results:
        if measure in difficulties.get(result.world, {}):
            groups.setdefault(result.world, []).append(float(result.success))
    if not groups:
        stated = sorted({name for values in difficulties.values() for name in values})
        raise ValueError(f"no world driven states '{measure}'; worlds state {', '.join(stated) or 'nothing'}")
    worlds = sorted(groups, key=lambda world: (difficulties[world][measure], world))
    parts = [part for part in np.array_split(np.array(worlds), min(MOST_GROUPS, len(worlds))) if len(part)]
    return [
        (float(np.mean([difficulties[world][measure] for world in part])),
         statistics.grouped_share({world: groups[world] for world in part}))
        for part in ([str(world) for world in part] for part in parts)
    ]


def plot(
    path: Path, names: Sequence[str], batches: Sequence[Sequence[EpisodeResult]],
    difficulties: Mapping[str, Mapping[str, float]], measure: Optional[str] = None,
) -> None:
    """Plot each batch's share of successes over difficulty.

    Args:
        path: Picture to write; its ending gives the format.
        names, batches: As for `as_table`.
        difficulties, measure: As for `by_difficulty`; path_length_ratio where `measure` is None.
    """
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    measure = measure or "path_length_ratio"
    figure, axes = pyplot.subplots(figsize=(7.0, 4.0), constrained_layout=True)
    for name, results in zip(names, batches):
        points = by_difficulty(results, difficulties, measure)
        shares = np.array([share for _, share in points])
        below, above = shares[:, 0] - shares[:, 1], shares[:, 2] - shares[:, 0]
        axes.errorbar([x for x, _ in points], shares[:, 0], np.clip([below, above], 0.0, 1.0), marker="o", capsize=3,
                      label=name)
    axes.set(xlabel=measure.replace("_", " "), ylabel="success (95 % interval)", ylim=(-0.03, 1.03))
    axes.legend()
    with whole_file(path) as stream:
        figure.savefig(stream, dpi=110, format=path.suffix[1:] or None)
    pyplot.close(figure)
