"""Public robots by their own files: what is made of each, whether it drives there and back, and what it is told."""

from __future__ import annotations

from typing import Any, Dict, Iterator, Sequence, Tuple

from contract import zoo

from benchmark.metric import Metric, NotMeasurable
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.tasks import EpisodeTask
from mbf_relay.navigation.examination import CLAMPED, DOUBTFUL, IGNORED, REFUSED, STOOD_IN, USED

QUICK = ("dingo_o", "husky", "limo_diff")
"""Of those that take the least computing."""
FIELDS = range(792000, 792006)
"""Seeds of the fields of obstacles."""
WARNINGS = (STOOD_IN, CLAMPED, IGNORED, DOUBTFUL)


def metrics(quick: bool) -> Iterator[Metric]:
    """Yield for each robot how long it took there and back."""
    try:
        from mbf_relay.lockstep.episode import Episode
    except ImportError as error:
        raise NotMeasurable(str(error)) from error
    for name in QUICK if quick else zoo.NAMES:
        alone = Episode(zoo.there_and_back(name), zoo.setup_for(name), seed=1).run()
        fields = [zoo.through_field(name, seed) for seed in FIELDS]
        yield driven(name, alone, [(task, Episode(task, zoo.setup_for(name), seed=1).run()) for task in fields])


def driven(name: str, alone: EpisodeResult, fields: Sequence[Tuple[EpisodeTask, EpisodeResult]]) -> Metric:
    """Return what is told of a robot's drives."""
    ended = [_end_of(task, result) for task, result in fields]
    reached = f"{ended.count('')} of {len(fields)}"
    return Metric(name, alone.time, "s", parameters={
        **described(name), "drives": alone.outcome if not alone.success else "yes", "contacts": alone.contacts,
        "fields": ", ".join([reached, *sorted(set(ended) - {""})]),
        "contacts there": sum(result.contacts for _task, result in fields)})


def _end_of(task: EpisodeTask, result: EpisodeResult) -> str:
    """Return how a drive failed, empty where it did not: a path that ends short of the goal counts as one to it."""
    if not result.success:
        return result.outcome
    return "" if result.final_error <= (task.goal_radius or 0.0) else "short of the goal"


def described(name: str) -> Dict[str, Any]:
    """Return what is told of a robot before it drives: all words but the counts of what it is warned of."""
    found = zoo.examined(name)
    length, width = zoo.footprint_of(found.config).ptp(axis=0)
    made_of = {finding.name: finding.text for finding in found.of(USED)}
    chosen = [found.config[kind][0] for kind in ("planners", "controllers")]
    return {
        "files of": zoo.SETS[name]["source"],
        "footprint [m]": f"{length:.2f} x {width:.2f}",
        "wheels": zoo.SETS[name]["drive"],
        "asked for": ", ".join(entry["type"].rpartition("/")[2] for entry in chosen),
        "drives by": ", ".join(made_of.get(entry["name"], "-").rpartition(" ")[2] for entry in chosen),
        "loads": "no" if found.of(REFUSED) else "yes",
        **{f"{kind}": len(found.of(kind)) for kind in WARNINGS},
    }
