"""Trials: replays of logs with many seeds and under stress, and a table of their errors with intervals."""

from __future__ import annotations

import math
from typing import Any, Dict, Iterator, List, NamedTuple, Optional, Sequence

import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.localization.logs import RecordedLog
from mbf_relay.localization.parameters import LocalizerParameters
from mbf_relay.localization.replay import LOST_FROM, errors, replay, require_use
from mbf_relay.localization.stress import Stress, stressed
from mbf_relay.maps import OccupancyMap
from mbf_relay.statistics import IntervalEstimate, grouped_share, mean

RIGHT_WITHIN = 0.5
"""Error (m) up to which a pose counts as right."""
LAST = 10
"""Scans at the end of a drive whose median error tells whether the robot is lost."""
FIGURES = ("right", "median", "p95", "lost")
"""Share of the scans within RIGHT_WITHIN, errors (m), and whether the robot was lost at the end."""


class LogTask(NamedTuple):
    """A log to be tried: its name, the drive, the map, the start (anywhere where None) and the start's covariance."""

    name: str
    log: RecordedLog
    occupancy: OccupancyMap
    start: Optional[Pose2D]
    covariance: np.ndarray


class Trial(NamedTuple):
    """What came of one: log, stress, seed, and figures by their names in FIGURES; None where nobody knows the truth."""

    name: str
    stress: str
    seed: int
    figures: Optional[Dict[str, float]]


def run(
    task: LogTask, parameters: LocalizerParameters, stresses: Sequence[Stress], seeds: Sequence[int]
) -> Iterator[Trial]:
    """Try a log under each stress with each seed, which both the stress and the filter draw from.

    Args:
        task: The log.
        parameters: Of the filter.
        stresses: How it is made harder.
        seeds: Of chance.

    Raises:
        ValueError: The map is empty, the start is not on it, or nothing of the log as recorded could be used.
    """
    for stress in stresses:
        for seed in seeds:
            rng = np.random.default_rng(seed)
            log, occupancy = stressed(task.log, task.occupancy, stress, rng)
            result = replay(log, occupancy, parameters, rng, task.start, task.covariance)
            if stress == Stress():  # under stress, a filter with nothing to go by is what is asked about
                require_use(result, task.name)
            yield Trial(task.name, str(stress), seed, _figures(result.poses, log.reference))


def _figures(poses: np.ndarray, reference: Optional[np.ndarray]) -> Optional[Dict[str, float]]:
    if reference is None:
        return None
    off = errors(poses, reference)["translation"]
    off = off[np.isfinite(off)]
    if not len(off):
        return None
    return {
        "right": float((off < RIGHT_WITHIN).mean()), "median": float(np.median(off)),
        "p95": float(np.percentile(off, 95)), "lost": float(np.median(off[-LAST:]) > LOST_FROM),
    }


def summarize_trials(trials: Sequence[Trial]) -> List[Dict[str, Any]]:
    """Return a row for each log and stress, and for each stress over all logs where there are several."""
    rows, names = [], list(dict.fromkeys(trial.name for trial in trials))
    for stress in dict.fromkeys(trial.stress for trial in trials):
        of_stress = [trial for trial in trials if trial.stress == stress]
        groups = [(name, [trial for trial in of_stress if trial.name == name]) for name in names]
        for name, chosen in groups + ([("all", of_stress)] if len(names) > 1 else []):
            row: Dict[str, Any] = {"log": name, "stress": stress, "trials": len(chosen)}
            row.update({figure: _estimate(_by_log(chosen, figure), figure) for figure in FIGURES})
            rows.append(row)
    return rows


def _estimate(values: Dict[str, List[float]], figure: str) -> IntervalEstimate:
    """Return a figure over the trials of logs; no interval of a share leaves 0 to 1."""
    if figure == "lost":
        return grouped_share(values)
    estimate = mean(values)
    if figure != "right" or not estimate.has_interval:
        return estimate
    return estimate._replace(low=max(0.0, estimate.low), high=min(1.0, estimate.high))


def _by_log(trials: Sequence[Trial], figure: str) -> Dict[str, List[float]]:
    """Return a figure's values in trials whose truth is known, by the log's name."""
    values: Dict[str, List[float]] = {}
    for trial in trials:
        if trial.figures is not None:
            values.setdefault(trial.name, []).append(trial.figures[figure])
    return values


def table(rows: Sequence[Dict[str, Any]]) -> str:
    """Return rows for people: means and shares, each with its 95 % interval."""
    head = ["log", "stress", "trials", f"within {RIGHT_WITHIN} m", "median [m]", "p95 [m]", "lost"]
    lines = [head] + [
        [row["log"], row["stress"], str(row["trials"]), *(_cell(row[figure]) for figure in FIGURES)] for row in rows
    ]
    widths = [max(len(line[column]) for line in lines) for column in range(len(head))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths)).rstrip() for line in lines)


def _cell(estimate: IntervalEstimate) -> str:
    if math.isnan(estimate.value):
        return "-"
    return f"{estimate.value:.3f} {estimate.interval() if estimate.has_interval else ''}".rstrip()


def as_json(rows: Sequence[Dict[str, Any]]) -> List[Dict[str, Any]]:
    """Return rows as JSON takes them: of each figure value, low and high, None where there is none."""
    return [
        {
            key: {k: None if math.isnan(v) else v for k, v in value._asdict().items()} if key in FIGURES else value
            for key, value in row.items()
        }
        for row in rows
    ]
