"""The batch command: many worlds, several seeds, all cores or a cluster."""

from __future__ import annotations

import argparse
import hashlib
import sys
import time
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional, Sequence

from mbf_relay.lockstep import batch_report
from mbf_relay.lockstep.command import Progress, without_remappings
from mbf_relay.lockstep.episodes import EpisodeJob, drive_all
from mbf_relay.lockstep.options import add_setup_options, add_worker_options, seeds, setup_of, share
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.results_file import WORLDS, ResultsFile
from mbf_relay.lockstep.settings import flatten
from mbf_relay.lockstep.setup import Setup, named_robot
from mbf_relay.lockstep.sources import files_of, plugins_of, sources
from mbf_relay.lockstep.tasks import EpisodeTask, load_tasks, warnings_of
from mbf_relay.lockstep.workers import workers_for
from mbf_relay.simulation.robot_file import robot_text


def main(arguments: Optional[Sequence[str]] = None, clock: Callable[[], float] = time.perf_counter) -> int:
    """Run the command; return its exit status.

    It is 0 where all episodes have a result, good or bad, 1 for an error of the user's or the cluster's and where a
    smaller share than --require succeeded, 130 when interrupted.
    """
    options = _parse(without_remappings(sys.argv[1:] if arguments is None else arguments))
    try:
        all_tasks = [task.scaled(options.scale) for task in load_tasks(options.worlds)]
        tasks = _chosen(all_tasks, options.only)
        setup = setup_of(options, tasks)
        for note in [*setup.notes, *warnings_of(tasks)]:
            print(f"batch.py: {note}", file=sys.stderr)
        folder = options.out or Path(f"batch-{Path(options.worlds).stem}")
        results = ResultsFile(folder, settings_of(Path(options.worlds).name, all_tasks, setup))
        try:
            jobs = [EpisodeJob(task, setup, seed) for seed in options.seeds for task in tasks]
            status = _drive(results, jobs, options, clock)
        finally:
            results.close()
        batch_report.leave(folder, results.results, all_tasks, 1 if status else options.jobs, options.trajectories)
        if status == 0:
            _check_share(results.results, jobs, options.require)
    except (OSError, ValueError) as error:
        print(f"batch.py: {error}", file=sys.stderr)
        return 1
    return status


def settings_of(worlds: str, tasks: Sequence[EpisodeTask], setup: Setup) -> Dict[str, Any]:
    """Return all that results of one batch must have in common: worlds, parameters, robot, code; not seeds or machine.
    """
    digests = {task.name: task.digest()[:16] for task in tasks}
    digest = hashlib.sha256("\n".join(digests.values()).encode()).hexdigest()[:16]
    code = sources(plugins_of(setup))
    return {
        "worlds": worlds, "worlds_digest": digest, WORLDS: digests, "localization": setup.localization,
        "map": setup.map, "map_resolution": setup.map_resolution, "controller": setup.controller,
        "planner": setup.planner, "after_contact": setup.after_contact, "robot_digest": _robot_digest(setup),
        "version": code.version, "sources": code.package, "plugins": code.plugins,
        "files": files_of(setup), **flatten(setup.settings),
    }


def _robot_digest(setup: Setup) -> str:
    """Return a hash over the robot's file and the shapes of its bodies, as these may come from mesh files."""
    known = hashlib.sha256(robot_text(named_robot(setup.settings)).encode())
    for part in setup.robot.body if setup.robot is not None else ():
        known.update(part.shape.triangles().tobytes())
    return known.hexdigest()[:16]


def _drive(
    results: ResultsFile, jobs: Sequence[EpisodeJob], options: argparse.Namespace, clock: Callable[[], float]
) -> int:
    """Drive the episodes that have no result yet, and write each result; return the command's exit status."""
    for warning in results.warnings:
        print(f"batch.py: {warning}", file=sys.stderr)
    done = results.done - (results.failed if options.retry_failed else set())
    waiting = [job for job in jobs if (job.task.name, job.seed) not in done]
    if len(waiting) < len(jobs):
        print(f"{len(jobs) - len(waiting)} of {len(jobs)} episodes have a result already", file=sys.stderr)
    if not waiting:
        return 0
    progress = Progress(len(waiting))
    plugins = plugins_of(waiting[0].setup)
    try:
        with workers_for(len(waiting), options.jobs, plugins, options.scheduler, options.scheduler_file) as workers:
            start = clock()
            for count, (_, result) in enumerate(drive_all(waiting, workers, options.time_limit), 1):
                results.append(result)
                progress.show(count, clock() - start, _so_far(results.results))
    except KeyboardInterrupt:
        print("\ninterrupted; the same command goes on where this one ended", file=sys.stderr)
        return 130
    except (OSError, ValueError) as error:
        print(f"batch.py: {error}", file=sys.stderr)
        return 1
    finally:
        progress.end()
    return 0


def _check_share(results: Sequence[EpisodeResult], jobs: Sequence[EpisodeJob], required: float) -> None:
    """Raise ValueError where less than the required share of the episodes succeeded."""
    asked = {(job.task.name, job.seed) for job in jobs}
    succeeded = sum(result.success for result in results if (result.world, result.seed) in asked)
    if succeeded < required * len(asked) - 1e-9:
        raise ValueError(f"{succeeded} of {len(asked)} drives succeeded, and --require asks for {required:g} of them")


def _so_far(results: Sequence[EpisodeResult]) -> str:
    return f"{sum(result.success for result in results)} of {len(results)} succeeded"


def _chosen(tasks: Sequence[EpisodeTask], names: Optional[Sequence[str]]) -> List[EpisodeTask]:
    """Return the tasks of the given names, or all where none is given; raise ValueError for an unknown name."""
    if not names:
        return list(tasks)
    missing = sorted(set(names) - {task.name for task in tasks})
    if missing:
        raise ValueError(f"there is no world '{missing[0]}'; there are {', '.join(task.name for task in tasks)}")
    return [task for task in tasks if task.name in names]


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="batch.py", description="Drive many worlds without ROS and sum up how it went."
    )
    parser.add_argument("worlds", metavar="WORLDS", help="a worlds file (JSON), or 'circle' for the tutorial's circle")
    add_setup_options(parser)
    parser.add_argument(
        "--only", action="append", metavar="WORLD", help="drive only this world of the file; may be repeated"
    )
    parser.add_argument(
        "--seeds", type=seeds, default=[1], metavar="N|A-B",
        help="drive each world with seeds 1 to N, or A to B (default 1)"
    )
    add_worker_options(parser)
    parser.add_argument(
        "--retry-failed", action="store_true", help="repeat drives that crashed, hung or could not be started"
    )
    parser.add_argument(
        "--require", type=share, default=0.0, metavar="SHARE",
        help="exit with status 1 if a smaller share of the drives, 0 to 1, succeeded (default 0: never)",
    )
    parser.add_argument("--trajectories", action="store_true", help="also write an .npz file of each drive")
    parser.add_argument(
        "--out", type=Path, metavar="DIR",
        help="folder for results, from which a batch is also resumed (default batch-WORLDS)"
    )
    return parser.parse_args(arguments)
