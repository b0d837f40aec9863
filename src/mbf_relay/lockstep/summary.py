"""Summaries of batches: means and shares with 95 % intervals, of one batch or of two that are compared."""

from __future__ import annotations

import dataclasses
from typing import Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple, TypeVar

from mbf_relay import statistics
from mbf_relay.lockstep import result as outcomes
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.statistics import IntervalEstimate

Key = Tuple[str, int]
"""World and seed."""
Number = TypeVar("Number", int, float)


@dataclasses.dataclass(frozen=True)
class Measure:
    """A metric of an episode.

    Attributes:
        name: Its name in tables and in the summary's JSON.
        unit: Empty for a share or a plain number.
        of: Returns its value for a result; None where the episode has none.
        is_share: Whether it is 0 or 1, so that its mean is a share.
        better: 1 where more is better, -1 where less is, 0 where it cannot be optimized: neither is better, or failed
            episodes lack it.
    """

    name: str
    unit: str
    of: Callable[[EpisodeResult], Optional[float]]
    is_share: bool = False
    better: int = 0


def _if_driven(value: Callable[[EpisodeResult], Optional[float]]) -> Callable[[EpisodeResult], Optional[float]]:
    return lambda episode: value(episode) if episode.outcome != outcomes.ERROR else None


def _if_successful(value: Callable[[EpisodeResult], Optional[float]]) -> Callable[[EpisodeResult], Optional[float]]:
    return lambda episode: value(episode) if episode.success else None


def _wait(episode: EpisodeResult) -> Optional[float]:
    return sum(episode.goal_waits) / len(episode.goal_waits) if episode.goal_waits else None


def _share(outcome: str) -> Callable[[EpisodeResult], float]:
    return lambda episode: float(episode.outcome == outcome)


MEASURES: Sequence[Measure] = (
    Measure("success", "", lambda episode: float(episode.success), is_share=True, better=1),
    Measure("contact", "", _share(outcomes.CONTACT), is_share=True, better=-1),
    Measure("contact by the robot's fault", "", lambda episode: float(episode.contacts_at_fault > 0),
            is_share=True, better=-1),
    Measure("timeout", "", _share(outcomes.TIMEOUT), is_share=True, better=-1),
    Measure("error", "", _share(outcomes.ERROR), is_share=True, better=-1),
    Measure("score", "", lambda episode: episode.score, better=1),
    Measure("time of successes", "s", _if_successful(lambda episode: episode.time)),
    Measure("path length of successes", "m", _if_successful(lambda episode: episode.path_length)),
    Measure("smallest clearance", "m", _if_driven(lambda episode: episode.smallest_clearance), better=1),
    Measure("closest approach", "m", _if_driven(lambda episode: episode.closest_approach), better=1),
    Measure("time to collision", "s", _if_driven(lambda episode: episode.time_to_collision)),
    Measure("final error of successes", "m", _if_successful(lambda episode: episode.final_error)),
    Measure("localization error, mean", "m", _if_driven(lambda episode: episode.localization_error_mean), better=-1),
    Measure("localization error, max", "m", _if_driven(lambda episode: episode.localization_error_max), better=-1),
    Measure("heading error, mean", "rad", _if_driven(lambda episode: episode.heading_error_mean), better=-1),
    Measure("changes of turning side", "/m", _if_driven(lambda episode: episode.smoothness.turn_changes_per_metre),
            better=-1),
    Measure("acceleration, mean", "m/s2", _if_driven(lambda episode: episode.smoothness.mean_acceleration), better=-1),
    Measure("jerk, mean", "m/s3", _if_driven(lambda episode: episode.smoothness.mean_jerk), better=-1),
    Measure("within tolerance before reached", "s", _wait),
    Measure("standing still", "", _if_driven(lambda episode: episode.smoothness.standing_share), better=-1),
)


def measure_of(name: str) -> Measure:
    """Return the measure of a name."""
    return next(measure for measure in MEASURES if measure.name == name)


def summarize(results: Iterable[EpisodeResult]) -> Dict[str, IntervalEstimate]:
    """Return each measure's mean and 95 % interval over the episodes that have it."""
    results = list(results)
    return {measure.name: _estimate(measure, results) for measure in MEASURES}


def _estimate(measure: Measure, results: Sequence[EpisodeResult]) -> IntervalEstimate:
    groups = _by_world((episode.world, measure.of(episode)) for episode in results)
    return statistics.grouped_share(groups) if measure.is_share else statistics.mean(groups)


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Comparison of two batches, paired by world and seed.

    Attributes:
        pairs: Number of episodes (world and seed) that both have.
        only_first, only_second: Number of episodes that only one has.
        first, second: Mean of each measure over the pairs in which both episodes have it.
        differences: Mean of second minus first over these pairs.
        gained, lost: Episodes in which only the second, or only the first, succeeded.
        chance: p-value of an exact sign test on success over worlds.
        worlds: Number of worlds of the pairs; each counts once in the test, however many seeds it has.
    """

    pairs: int
    only_first: int
    only_second: int
    first: Mapping[str, IntervalEstimate]
    second: Mapping[str, IntervalEstimate]
    differences: Mapping[str, IntervalEstimate]
    gained: List[Key]
    lost: List[Key]
    chance: float
    worlds: int


def compare(first: Iterable[EpisodeResult], second: Iterable[EpisodeResult]) -> Comparison:
    """Compare results, paired by world and seed, so that the worlds' difficulty cancels out."""
    a = {(episode.world, episode.seed): episode for episode in first}
    b = {(episode.world, episode.seed): episode for episode in second}
    keys = sorted(set(a) & set(b))
    of_first, of_second, differences = {}, {}, {}
    for measure in MEASURES:
        ones, _ = paired(measure, b.values(), a.values())
        twos, steps = paired(measure, a.values(), b.values())
        of_first[measure.name], of_second[measure.name] = statistics.mean(ones), statistics.mean(twos)
        differences[measure.name] = statistics.mean(steps)
    gained = [key for key in keys if b[key].success and not a[key].success]
    lost = [key for key in keys if a[key].success and not b[key].success]
    chance = statistics.sign_test(_by_world((key[0], int(b[key].success) - int(a[key].success)) for key in keys))
    return Comparison(
        len(keys), len(a) - len(keys), len(b) - len(keys), of_first, of_second, differences, gained, lost, chance,
        len({world for world, _ in keys}),
    )


def paired(
    measure: Measure, first: Iterable[EpisodeResult], second: Iterable[EpisodeResult]
) -> Tuple[Dict[str, List[float]], Dict[str, List[float]]]:
    """Return the second's values of a measure, and their differences from the first's, both by world.

    Args:
        measure: The measure; only episodes (world and seed) in which both have a value count.
        first, second: Results.
    """
    a = {(episode.world, episode.seed): measure.of(episode) for episode in first}
    b = {(episode.world, episode.seed): measure.of(episode) for episode in second}
    both = [(key[0], a[key], b[key]) for key in sorted(set(a) & set(b))]
    known = [(world, one, two) for world, one, two in both if one is not None and two is not None]
    values = _by_world((world, two) for world, _, two in known)
    return values, _by_world((world, two - one) for world, one, two in known)


def _by_world(samples: Iterable[Tuple[str, Optional[Number]]]) -> Dict[str, List[Number]]:
    groups: Dict[str, List[Number]] = {}
    for world, sample in samples:
        if sample is not None:
            groups.setdefault(world, []).append(sample)
    return groups
