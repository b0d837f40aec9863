"""What many episodes came to: shares, means and their intervals, of one batch or of two side by side."""

from __future__ import annotations

import dataclasses
from typing import Callable, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

from mbf_relay.lockstep import result as outcomes
from mbf_relay.lockstep import statistics
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.statistics import Estimate

Key = Tuple[str, int]


@dataclasses.dataclass(frozen=True)
class Measure:
    """One figure of an episode.

    Attributes:
        name: For people and for the summary's JSON.
        unit: Empty for a share or a plain number.
        of: Takes it from a result; None where the episode has none.
        is_share: Whether it is 0 or 1, so that its mean is a share.
    """

    name: str
    unit: str
    of: Callable[[EpisodeResult], Optional[float]]
    is_share: bool = False


def _if_driven(value: Callable[[EpisodeResult], Optional[float]]) -> Callable[[EpisodeResult], Optional[float]]:
    return lambda episode: value(episode) if episode.outcome != outcomes.ERROR else None


def _if_successful(value: Callable[[EpisodeResult], Optional[float]]) -> Callable[[EpisodeResult], Optional[float]]:
    return lambda episode: value(episode) if episode.success else None


def _wait(episode: EpisodeResult) -> Optional[float]:
    return sum(episode.goal_waits) / len(episode.goal_waits) if episode.goal_waits else None


def _share(outcome: str) -> Callable[[EpisodeResult], float]:
    return lambda episode: float(episode.outcome == outcome)


MEASURES: Sequence[Measure] = (
    Measure("success", "", lambda episode: float(episode.success), is_share=True),
    Measure("contact", "", _share(outcomes.CONTACT), is_share=True),
    Measure("timeout", "", _share(outcomes.TIMEOUT), is_share=True),
    Measure("error", "", _share(outcomes.ERROR), is_share=True),
    Measure("score", "", lambda episode: episode.score),
    Measure("time of successes", "s", _if_successful(lambda episode: episode.time)),
    Measure("path length of successes", "m", _if_successful(lambda episode: episode.path_length)),
    Measure("smallest clearance", "m", _if_driven(lambda episode: episode.smallest_clearance)),
    Measure("final error of successes", "m", _if_successful(lambda episode: episode.final_error)),
    Measure("localization error, mean", "m", _if_driven(lambda episode: episode.localization_error_mean)),
    Measure("localization error, max", "m", _if_driven(lambda episode: episode.localization_error_max)),
    Measure("heading error, mean", "rad", _if_driven(lambda episode: episode.heading_error_mean)),
    Measure("changes of turning side", "/m", _if_driven(lambda episode: episode.smoothness.turn_changes_per_metre)),
    Measure("acceleration, mean", "m/s2", _if_driven(lambda episode: episode.smoothness.mean_acceleration)),
    Measure("jerk, mean", "m/s3", _if_driven(lambda episode: episode.smoothness.mean_jerk)),
    Measure("within tolerance before reached", "s", _wait),
    Measure("standing still", "", _if_driven(lambda episode: episode.smoothness.standing_share)),
)


def summarize(results: Iterable[EpisodeResult]) -> Dict[str, Estimate]:
    """Return each measure's mean and 95 % interval over the episodes that have it."""
    results = list(results)
    return {measure.name: _estimate(measure, results) for measure in MEASURES}


def _estimate(measure: Measure, results: Sequence[EpisodeResult]) -> Estimate:
    groups = _by_world((episode.world, measure.of(episode)) for episode in results)
    return statistics.grouped_share(groups) if measure.is_share else statistics.mean(groups)


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Two sets of results side by side.

    Attributes:
        pairs: Number of episodes (world and seed) that both have.
        only_first, only_second: Episodes that one alone has.
        first, second: Each measure over the pairs; where it is of successes, over the pairs in which both succeeded.
        differences: Second less first, from the pairs.
        gained, lost: Episodes that only the second, or only the first, brought to success.
        chance: How likely a split at least as uneven is if both were equally good (exact sign test).
    """

    pairs: int
    only_first: int
    only_second: int
    first: Mapping[str, Estimate]
    second: Mapping[str, Estimate]
    differences: Mapping[str, Estimate]
    gained: List[Key]
    lost: List[Key]
    chance: float


def compare(first: Iterable[EpisodeResult], second: Iterable[EpisodeResult]) -> Comparison:
    """Compare results, paired by world and seed, so that what a world does to both of them cancels."""
    a = {(episode.world, episode.seed): episode for episode in first}
    b = {(episode.world, episode.seed): episode for episode in second}
    keys = sorted(set(a) & set(b))
    of_first, of_second, differences = {}, {}, {}
    for measure in MEASURES:
        pairs = [(world, measure.of(a[world, seed]), measure.of(b[world, seed])) for world, seed in keys]
        both = [(world, one, two) for world, one, two in pairs if one is not None and two is not None]
        of_first[measure.name] = statistics.mean(_by_world((world, one) for world, one, _ in both))
        of_second[measure.name] = statistics.mean(_by_world((world, two) for world, _, two in both))
        differences[measure.name] = statistics.mean(_by_world((world, two - one) for world, one, two in both))
    gained = [key for key in keys if b[key].success and not a[key].success]
    lost = [key for key in keys if a[key].success and not b[key].success]
    chance = statistics.sign_test(len(gained), len(lost))
    return Comparison(
        len(keys), len(a) - len(keys), len(b) - len(keys), of_first, of_second, differences, gained, lost, chance
    )


def _by_world(samples: Iterable[Tuple[str, Optional[float]]]) -> Dict[str, List[float]]:
    groups: Dict[str, List[float]] = {}
    for world, sample in samples:
        if sample is not None:
            groups.setdefault(world, []).append(sample)
    return groups
