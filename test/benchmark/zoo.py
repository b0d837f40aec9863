"""Public robots by their own files: what is made of each, whether it drives there and back, and what it is told."""

from __future__ import annotations

from typing import Any, Dict, Iterator

from contract import zoo

from benchmark.metric import Metric, NotMeasurable
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.navigation.examination import CLAMPED, DOUBTFUL, IGNORED, REFUSED, STOOD_IN, USED

QUICK = ("dingo_o", "husky", "limo_diff")
"""Of those that take the least computing."""
WARNINGS = (STOOD_IN, CLAMPED, IGNORED, DOUBTFUL)


def metrics(quick: bool) -> Iterator[Metric]:
    """Yield for each robot how long it took there and back."""
    try:
        from mbf_relay.lockstep.episode import Episode
    except ImportError as error:
        raise NotMeasurable(str(error)) from error
    for name in QUICK if quick else zoo.NAMES:
        yield driven(name, Episode(zoo.there_and_back(name), zoo.setup_for(name), seed=1).run())


def driven(name: str, result: EpisodeResult) -> Metric:
    """Return what is told of a robot's drive."""
    return Metric(name, result.time, "s", parameters={
        **described(name), "drives": result.outcome if not result.success else "yes", "contacts": result.contacts})


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
