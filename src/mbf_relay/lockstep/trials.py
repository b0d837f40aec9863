"""The trials of a parameter search with Optuna: drawn in rounds, driven in parallel, pruned when they are poor.

A round's trials depend on the results of complete earlier rounds alone, not on each other or the order in which they
end. So a search that was interrupted and resumed gives the same trials as one that was not.
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
"""A trial first drives one in so many worlds; a poor one is pruned after that."""
DRAWN_AT_RANDOM, NEVER_GIVEN_UP = 8, 5
"""Optuna's n_startup_trials of the TPE sampler (random trials at first) and of the median pruner."""

Parameters = Mapping[str, Union[int, float]]
"""Parameter values by full name."""


class Range(NamedTuple):
    """The range of a parameter, ends included; `whole` for integers."""

    low: float
    high: float
    whole: bool

    def distribution(self) -> Any:
        """Return the range as an Optuna distribution."""
        from optuna import distributions

        if self.whole:
            return distributions.IntDistribution(int(self.low), int(self.high))
        return distributions.FloatDistribution(self.low, self.high)


Space = Dict[str, Range]
"""The search space: ranges by full parameter name."""


class Plan(NamedTuple):
    """Settings of a search.

    Attributes:
        trials: Number of trials in the end.
        together: Number of trials of a round, which are driven in parallel.
        seed: Seed of the sampler.
        metric: Name of the measure to optimize.
    """

    trials: int
    together: int
    seed: int
    metric: str


@dataclass(frozen=True)
class TrialDrives:
    """Drives the episodes of trials.

    Attributes:
        workers: Run the episodes.
        seeds: Seeds with which each world is driven.
        time_limit: Seconds of CPU time after which an episode counts as hung.
        setup_of: Returns the setup for a trial's parameters.
    """

    workers: Workers
    seeds: Sequence[int]
    time_limit: float
    setup_of: Callable[[Parameters], Setup]

    def with_other_seeds(self, seeds: Sequence[int]) -> TrialDrives:
        """Return the same with other seeds."""
        return replace(self, seeds=seeds)

    def results(self, wanted: Sequence[Tuple[Parameters, Sequence[EpisodeTask]]]) -> List[List[EpisodeResult]]:
        """Drive all episodes in parallel; return the results of each pair in `wanted`, sorted by world and seed."""
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
    """Run trials until the study has as many as planned.

    Args:
        study: Optuna's study, on disk.
        space: Ranges by parameter.
        plan: Settings of the search.
        tasks: The worlds to tune on.
        driving: Drives the episodes.
        tell: Called with a line for each trial.
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
    """Drive a round's trials; return the result of each, as arguments of Optuna's create_trial.

    Args:
        trials: Trials drawn by Optuna.
        metric: Name of the measure to optimize.
        tasks: The worlds.
        driving: Drives the episodes.
        first: Number of the first trial.

    Raises:
        ValueError: No episode has the metric.
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
    """Return the value to maximize: a measure's mean over results, negated where less of it is better.

    A result without a value, such as one that could not be driven, counts as 0 where more is better and as infinite
    where less is.
    """
    measure = measure_of(metric)
    worst = 0.0 if measure.better > 0 else math.inf
    values = [worst if value is None else value for value in map(measure.of, results)]
    return measure.better * sum(values) / len(values)


def _require(metric: str, results: Sequence[EpisodeResult], number: int) -> None:
    """Raise ValueError where no episode that was driven has the measure, as in worlds without a reference path."""
    driven = [result for result in results if result.outcome != ERROR]
    if driven and all(measure_of(metric).of(result) is None for result in driven):
        raise ValueError(f"no drive of trial {number + 1} has a '{metric}'; these worlds have nothing to measure it by")
