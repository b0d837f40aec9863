"""The batch command: many worlds, several seeds, all cores."""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import sys
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple

from mbf_relay.lockstep import pictures
from mbf_relay.lockstep.command import Progress, finite, without_remappings
from mbf_relay.lockstep.episode import Episode
from mbf_relay.lockstep.pool import Pool
from mbf_relay.lockstep.result import ERROR, EpisodeResult, failed
from mbf_relay.lockstep.results_file import ResultsFile
from mbf_relay.lockstep.settings import config_folder, flatten
from mbf_relay.lockstep.setup import LOCALIZATIONS, MAPS, Setup, make_setup
from mbf_relay.lockstep.summary import MEASURES, summarize
from mbf_relay.lockstep.tasks import Task, load_tasks

HANG = 900.0
"""Seconds of wall time after which an episode counts as hung."""

Job = Tuple[Task, Setup, int]
"""An episode to drive: where, how, and the seed."""


def main(arguments: Optional[Sequence[str]] = None, clock: Callable[[], float] = time.perf_counter) -> int:
    """Run the command; return its exit status: 0, 1 for what a user can mend, 130 when interrupted."""
    options = _parse(without_remappings(sys.argv[1:] if arguments is None else arguments))
    try:
        all_tasks = load_tasks(options.worlds)
        tasks = _chosen(all_tasks, options.only)
        setup = make_setup(
            config_folder(), options.localization, options.map, options.controller, options.planner, options.set,
            all(task.has_map for task in tasks),
        )
        folder = options.out or Path(f"batch-{Path(options.worlds).stem}")
        results = ResultsFile(folder, _settings(options, setup, all_tasks))
    except ValueError as error:
        print(f"batch.py: {error}", file=sys.stderr)
        return 1
    try:
        status = _drive(results, _jobs(tasks, setup, options.seeds), options.jobs, clock)
    finally:
        results.close()
    _leave(folder, results, all_tasks)
    return status


def drive(job: Job) -> EpisodeResult:
    """Drive one episode; in a worker process. What cannot be driven is a failed result that says why."""
    task, setup, seed = job
    try:
        return Episode(task, setup, seed, clock=time.perf_counter).run()
    except ValueError as error:
        return failed(task.name, seed, str(error))


def run(jobs: Sequence[Job], processes: int) -> List[EpisodeResult]:
    """Drive episodes and return their results in the order of `jobs`; what was lost is a failed result."""
    ended = {}
    for (task, _setup, seed), result, lost in Pool(drive, processes, HANG).run(jobs):
        ended[task.name, seed] = result if lost is None else failed(task.name, seed, str(lost))
    return [ended[task.name, seed] for task, _setup, seed in jobs]


def _drive(results: ResultsFile, jobs: Sequence[Job], processes: int, clock: Callable[[], float]) -> int:
    """Drive what has no result yet; write each result as it comes."""
    for warning in results.warnings:
        print(f"batch.py: {warning}", file=sys.stderr)
    waiting = [job for job in jobs if (job[0].name, job[2]) not in results.done]
    if len(waiting) < len(jobs):
        print(f"{len(jobs) - len(waiting)} of {len(jobs)} episodes have a result already", file=sys.stderr)
    progress = Progress(len(waiting))
    start = clock()
    running = Pool(drive, min(processes, max(1, len(waiting))), HANG).run(waiting)
    try:
        for done, ((task, _setup, seed), result, lost) in enumerate(running, 1):
            results.append(result if lost is None else failed(task.name, seed, str(lost)))
            progress.show(done, clock() - start, _so_far(results.results))
    except KeyboardInterrupt:
        print("\ninterrupted; the same command goes on where this one ended", file=sys.stderr)
        return 130
    finally:
        running.close()
        progress.end()
    return 0


def _so_far(results: Sequence[EpisodeResult]) -> str:
    return f"{sum(result.success for result in results)} of {len(results)} succeeded"


def _leave(folder: Path, results: ResultsFile, tasks: Sequence[Task]) -> None:
    """Write summary and pictures, and tell the summary."""
    done = sorted(results.results, key=lambda result: (result.world, result.seed))
    if not done:
        return
    print(as_text(done))
    (folder / "summary.json").write_text(as_json(done), encoding="utf-8")
    by_name = {task.name: task for task in tasks}
    shown = [(by_name[result.world], result) for result in done if result.world in by_name]
    pictures.contact_sheet(shown, folder / "contact_sheet.png")
    for task, result in shown:
        if not result.success and result.outcome != ERROR:
            pictures.failure(task, result, folder / f"failure-{result.world}-{result.seed}.png")
    print(f"results, summary and pictures are in {folder}")


def as_text(results: Sequence[EpisodeResult]) -> str:
    """Return the summary as a table, and every failure with its reason."""
    lines = [f"{len(results)} episodes; means with 95 % intervals"]
    for measure in MEASURES:
        estimate = summarize(results)[measure.name]
        if estimate.value == estimate.value:
            title = measure.name + (f" [{measure.unit}]" if measure.unit else "")
            lines.append(f"  {title:34} {estimate}")
    for result in results:
        if not result.success:
            lines.append(f"  {result.world} (seed {result.seed}): {result.outcome} at {result.time:.1f} s. {result.message}")
    return "\n".join(lines)


def as_json(results: Sequence[EpisodeResult]) -> str:
    """Return the summary as JSON; what was not measured is null."""
    measures = {measure.name: measure for measure in MEASURES}
    values: Dict[str, Any] = {"episodes": len(results)}
    for name, estimate in summarize(results).items():
        value, low, high = finite(estimate)
        values[name] = {"value": value, "low": low, "high": high, "unit": measures[name].unit}
    return json.dumps(values, indent=1) + "\n"


def _jobs(tasks: Sequence[Task], setup: Setup, seeds: int) -> List[Job]:
    return [(task, setup, seed) for seed in range(1, seeds + 1) for task in tasks]


def _chosen(tasks: Sequence[Task], names: Optional[Sequence[str]]) -> List[Task]:
    """Return the tasks of these names, all where none are given."""
    if not names:
        return list(tasks)
    missing = sorted(set(names) - {task.name for task in tasks})
    if missing:
        raise ValueError(f"there is no world '{missing[0]}'; there are {', '.join(task.name for task in tasks)}")
    return [task for task in tasks if task.name in names]


def _settings(options: argparse.Namespace, setup: Setup, tasks: Sequence[Task]) -> Dict[str, Any]:
    """Return what makes two results comparable with each other: everything but seeds and the number of jobs."""
    worlds = hashlib.sha256("\n".join(task.digest() for task in tasks).encode()).hexdigest()[:16]
    return {
        "worlds": Path(options.worlds).name, "worlds_digest": worlds, "localization": setup.localization,
        "map": setup.map, "controller": setup.controller, "planner": setup.planner, **flatten(setup.settings),
    }


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="batch.py", description="Drive many worlds without ROS and sum up how it went.")
    parser.add_argument("worlds", metavar="WORLDS", help="a worlds file (JSON), or 'circle' for the tutorial's circle")
    parser.add_argument("--localization", choices=LOCALIZATIONS, help="where the pose comes from (default amcl; odometry without a map)")
    parser.add_argument("--map", choices=MAPS, help="whether the robot has a map of the world beforehand (default none for a worlds file)")
    parser.add_argument("--controller", default="", metavar="NAME", help="of move_base_flex.yaml; its first where not given")
    parser.add_argument("--planner", default="", metavar="NAME", help="likewise")
    parser.add_argument("--set", action="append", default=[], metavar="A.B=C", help="change a parameter of the nodes' files")
    parser.add_argument("--only", action="append", metavar="WORLD", help="drive this world of the file; may be repeated")
    parser.add_argument("--seeds", type=_positive, default=1, metavar="N", help="drive each world with seeds 1 to N")
    parser.add_argument("--jobs", type=_positive, default=os.cpu_count() or 1, metavar="N", help="processes (default: cores)")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where results go, and are resumed from (default batch-WORLDS)")
    return parser.parse_args(arguments)


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is below 1")
    return value
