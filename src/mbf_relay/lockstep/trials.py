"""The trials of a search: drawn in rounds, driven side by side, given up when they lose, noted so that it can go on.

A round's trials are drawn from what earlier rounds came to, and from nothing else: not from each other, nor from when
they ended. So a search that was interrupted anywhere, and went on, is the one that was not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple, Union

from mbf_relay.lockstep.episodes import EpisodeJob, Workers, drive_all
from mbf_relay.lockstep.result import ERROR, EpisodeResult
from mbf_relay.lockstep.setup import Setup
from mbf_relay.lockstep.summary import measure_of
from mbf_relay.lockstep.tasks import EpisodeTask

FIRST_LOOK = 3
"""A losing trial is given up after one in so many of its worlds."""
DRAWN_AT_RANDOM, NEVER_GIVEN_UP = 8, 5
"""Trials before the sampler is guided by earlier ones, and whole ones before a later one is held to their median."""

Parameters = Mapping[str, Union[int, float]]
"""Values by full name."""


class Range(NamedTuple):
    """The values a parameter may take: both ends are among them."""

    low: float
    high: float
    whole: bool

    def distribution(self) -> Any:
        """Return it as Optuna's."""
        from optuna import distributions

        if self.whole:
            return distributions.IntDistribution(int(self.low), int(self.high))
        return distributions.FloatDistribution(self.low, self.high)


Space = Dict[str, Range]


class Plan(NamedTuple):
    """How to search.

    Attributes:
        trials: How many there are to be in the end.
        together: How many a round has.
        seed: Of all chance in drawing.
        metric: What is to be better, a measure's name.
    """

    trials: int
    together: int
    seed: int
    metric: str


@dataclass(frozen=True)
class TrialDrives:
    """Drives worlds with parameters.

    Attributes:
        workers: Who drive.
        seeds: That each world is driven with.
        time_limit: Seconds of computing after which an episode counts as hung.
        setup_of: Makes the setup of parameters.
    """

    workers: Workers
    seeds: Sequence[int]
    time_limit: float
    setup_of: Callable[[Parameters], Setup]

    def with_other_seeds(self, seeds: Sequence[int]) -> TrialDrives:
        """Return the same with other seeds."""
        return replace(self, seeds=seeds)

    def results(self, wanted: Sequence[Tuple[Parameters, Sequence[EpisodeTask]]]) -> List[List[EpisodeResult]]:
        """Drive worlds with parameters, all side by side; return the results of each, in one order however they ended.
        """
        owners: Dict[int, int] = {}
        jobs = []
        for index, (parameters, tasks) in enumerate(wanted):
            setup = self.setup_of(parameters)
            for job in [EpisodeJob(task, setup, seed) for seed in self.seeds for task in tasks]:
                owners[id(job)] = index
                jobs.append(job)
        found: List[List[EpisodeResult]] = [[] for _ in wanted]
        for job, result in drive_all(jobs, self.workers, self.time_limit):
            found[owners[id(job)]].append(result)
        return [sorted(results, key=lambda result: (result.world, result.seed)) for results in found]


def search(
    study: Any, space: Space, plan: Plan, tasks: Sequence[EpisodeTask], driving: TrialDrives,
    tell: Callable[[str], None],
) -> None:
    """Try parameters until there are as many trials as planned.

    Args:
        study: Optuna's, on disk.
        space: Ranges by name.
        plan: How.
        tasks: The worlds to tune on.
        driving: Who drives.
        tell: Takes a line per trial.
    """
    import optuna

    ended = (optuna.trial.TrialState.COMPLETE, optuna.trial.TrialState.PRUNED)
    distributions = {name: between.distribution() for name, between in space.items()}
    while True:
        known = study.get_trials(states=ended)
        if len(known) >= plan.trials:
            return
        first = len(known) - len(known) % plan.together
        past = optuna.create_study(direction="maximize", pruner=optuna.pruners.MedianPruner(NEVER_GIVEN_UP))
        past.add_trials(known[:first])
        trials = []
        for number in range(len(known), min(first + plan.together, plan.trials)):
            past.sampler = optuna.samplers.TPESampler(seed=plan.seed + number, n_startup_trials=DRAWN_AT_RANDOM)
            trials.append(past.ask(distributions))
        for number, noted in enumerate(_tried(trials, plan.metric, tasks, driving, len(known)), len(known)):
            study.add_trial(optuna.trial.create_trial(distributions=distributions, **noted))
            given_up = noted["state"] is optuna.trial.TrialState.PRUNED
            value = measure_of(plan.metric).better * noted["intermediate_values"][max(noted["intermediate_values"])]
            tell(f"trial {number + 1}/{plan.trials}: {value:.3f}{' (given up)' if given_up else ''}")


def _tried(
    trials: Sequence[Any], metric: str, tasks: Sequence[EpisodeTask], driving: TrialDrives, first: int
) -> List[Dict[str, Any]]:
    """Return what came of a round's trials, as Optuna's create_trial takes it.

    Args:
        trials: Asked for.
        metric: What is to be better.
        tasks: The worlds.
        driving: Who drives.
        first: Number of the first trial.

    Raises:
        ValueError: The worlds have nothing to measure the metric by.
    """
    import optuna

    parts = [part for part in (tasks[0::FIRST_LOOK], [t for i, t in enumerate(tasks) if i % FIRST_LOOK]) if part]
    results: List[List[EpisodeResult]] = [[] for _ in trials]
    values: List[Dict[int, float]] = [{} for _ in trials]
    going_on = list(range(len(trials)))
    for step, part in enumerate(parts):
        for index, found in zip(going_on, driving.results([(trials[index].params, part) for index in going_on])):
            results[index] += found
            _require(metric, results[index], first + index)
            values[index][step] = value_of(results[index], metric)
            trials[index].report(values[index][step], step)
        if step < len(parts) - 1:
            going_on = [index for index in going_on if not trials[index].should_prune()]
    states = optuna.trial.TrialState
    return [
        {"params": trial.params, "intermediate_values": values[index],
         **({"state": states.COMPLETE, "value": values[index][len(parts) - 1]} if index in going_on
            else {"state": states.PRUNED})}
        for index, trial in enumerate(trials)
    ]


def value_of(results: Sequence[EpisodeResult], metric: str) -> float:
    """Return how good drives are: a measure's mean, or its negative where less of it is better.

    A drive without it, such as one that could not be driven, is as bad as can be: 0 where more is better, endless where
    less is.
    """
    measure = measure_of(metric)
    worst = 0.0 if measure.better > 0 else math.inf
    values = [worst if value is None else value for value in map(measure.of, results)]
    return measure.better * sum(values) / len(values)


def _require(metric: str, results: Sequence[EpisodeResult], number: int) -> None:
    """Raise ValueError where drives lack a measure though they were driven: their worlds have nothing to measure."""
    driven = [result for result in results if result.outcome != ERROR]
    if driven and all(measure_of(metric).of(result) is None for result in driven):
        raise ValueError(f"no drive of trial {number + 1} has a '{metric}'; these worlds have nothing to measure it by")
