"""The tune command: searches for better parameters with Optuna, and tests them on worlds kept from the search."""

from __future__ import annotations

import argparse
import contextlib
import functools
import json
import math
import os
import sys
from pathlib import Path
from typing import Any, Iterator, List, Optional, Sequence, Tuple
from urllib.parse import quote

import yaml

from mbf_relay.commands import positive, random_seed
from mbf_relay.files import parse_yaml, read_text
from mbf_relay.lockstep import tune_picture
from mbf_relay.lockstep.batch import settings_of
from mbf_relay.lockstep.command import have_alone, say, without_remappings
from mbf_relay.lockstep.compare_many import contrasts
from mbf_relay.lockstep.options import add_setup_options, add_worker_options, seeds, setup_of
from mbf_relay.lockstep.settings import config_folder, full_name, load_settings, own_part
from mbf_relay.lockstep.setup import Setup, known_types
from mbf_relay.lockstep.sources import plugins_of
from mbf_relay.lockstep.summary import MEASURES, measure_of
from mbf_relay.lockstep.tasks import EpisodeTask, load_tasks, warnings_of
from mbf_relay.lockstep.trials import Parameters, Plan, Range, Space, TrialDrives, search
from mbf_relay.lockstep.workers import tell, workers_for
from mbf_relay.whole_files import write_whole

HELD_OUT = 3
"""Every third world is kept from the search, for the final test."""
OTHER_SEEDS = 1000
"""Added to the seeds for the final test."""
KEPT = 64
"""Size of the cache of setups: a trial's setup is needed for each part of its worlds, the best one's also at the end.
"""


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command; return its exit status: 0, 1 for an error that a user can fix, 130 when interrupted."""
    options = _parse(without_remappings(sys.argv[1:] if arguments is None else arguments))
    try:
        tasks = [task.scaled(options.scale) for task in load_tasks(options.worlds)]
        seen, unseen = split(tasks)
        if options.metric == "score" and not any(task.reference_path_length for task in tasks):
            raise ValueError("the worlds state no reference_path_length, so that no drive has a score; choose another "
                             "--metric, such as success")
        setup = setup_of(options, tasks)
        for note in [*setup.notes, *warnings_of(tasks)]:
            tell(f"tune.py: {note}")
        space = read_space(options.param, options.space, setup)
        _check_ends(options, tasks, space, setup)
        count = len(seen) * len(options.seeds) * options.together
        where = options.scheduler, options.scheduler_file

        @functools.lru_cache(maxsize=KEPT)
        def changed(changes: Tuple[str, ...]) -> Setup:
            return setup_of(options, tasks, changes)

        def setup_with(parameters: Parameters) -> Setup:
            return changed(tuple(changes_of(parameters)))

        with _study_in(options.out):
            study = open_study(options, space, setup, tasks)
            with workers_for(count, options.jobs, plugins_of(setup), *where) as workers:
                drive = TrialDrives(workers, options.seeds, options.time_limit, setup_with)
                plan = Plan(options.trials, options.together, options.seed, options.metric)
                search(study, space, plan, seen, drive, tell)
                if not math.isfinite(study.best_value):
                    raise ValueError("no trial could drive every world, so that none is the best; batch.py tells why")
                best, better = dict(study.best_params), measure_of(options.metric).better
                write_best(options.out, setup_with(best))
                tune_picture.draw(
                    options.out / "study.png",
                    [(trial.params, better * trial.value) for trial in study.get_trials()
                     if trial.value is not None and math.isfinite(trial.value)],
                    better,
                )
                say("\n".join(f"{name}: {value:g}" for name, value in best.items()))
                say(verdict(unseen, best, drive, options.metric, is_unseen=len(seen) < len(tasks)))
    except (OSError, ValueError) as error:
        print(f"tune.py: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("\ninterrupted; the same command goes on where this one ended", file=sys.stderr)
        return 130
    return 0


def split(tasks: Sequence[EpisodeTask]) -> Tuple[List[EpisodeTask], List[EpisodeTask]]:
    """Return the worlds to tune on, and those for the final test; fewer than three serve for both, with other seeds."""
    kept = [task for index, task in enumerate(tasks) if index % HELD_OUT == HELD_OUT - 1]
    rest = [task for task in tasks if task not in kept] if kept else list(tasks)
    return rest, kept or list(tasks)


def read_space(texts: Sequence[str], file: Optional[Path], setup: Setup) -> Space:
    """Return the search space of options and file.

    Args:
        texts: Each "NAME=LOW:HIGH".
        file: YAML file of {NAME: [LOW, HIGH]}, or None.
        setup: The setup with the parameters to be tuned.

    Raises:
        ValueError: A range is empty or malformed, or a name is unknown; the text suggests the nearest.
    """
    ranges: List[Tuple[str, Any, Any]] = []
    if file is not None:
        try:
            content = parse_yaml(read_text(str(file)))
            ranges += [(str(name), low, high) for name, (low, high) in content.items()]
        except (OSError, AttributeError, TypeError, ValueError) as error:
            raise ValueError(f"space file {file} holds no ranges {{NAME: [LOW, HIGH]}}: {error}") from error
    for text in texts:
        name, _, between = text.partition("=")
        low, _, high = between.partition(":")
        ranges.append((name, low, high))
    if not ranges:
        raise ValueError("nothing to tune: give --param NAME=LOW:HIGH or --space FILE")
    types = known_types(setup.settings)
    space: Space = {}
    for name, first, last in ranges:
        full = full_name(name, sorted(types))
        space[full] = _range(name, first, last, types[full])
    return dict(sorted(space.items()))


def _range(name: str, first: Any, last: Any, declared: Any) -> Range:
    """Return a parameter's range.

    Args:
        name: The parameter's name, for errors.
        first, last: The ends, as text or from YAML.
        declared: The parameter's type.

    Raises:
        ValueError: The range is invalid, or the parameter is no number.
    """
    try:
        low, high = float(first), float(last)
    except (TypeError, ValueError):
        raise ValueError(f"the range of {name} is {first} to {last}; it must be two numbers, LOW:HIGH") from None
    if not low < high or not math.isfinite(high - low):
        raise ValueError(f"the range of {name}, {low:g} to {high:g}, is empty")
    whole = declared in (int, Optional[int])
    if not whole and declared not in (float, Optional[float]):
        raise ValueError(f"{name} is no number; only numbers have a range")
    if whole and not (low.is_integer() and high.is_integer()):
        raise ValueError(f"the range of {name} is {low:g} to {high:g}; it is a whole number, and so must its ends be")
    return Range(low, high, whole)


def _check_ends(options: argparse.Namespace, tasks: Sequence[EpisodeTask], space: Space, setup: Setup) -> None:
    """Raise ValueError where an end of a range is refused, or would be changed, as by clamping."""
    for name, between in space.items():
        for end in (between.low, between.high):
            found = setup_of(options, tasks, changes_of({name: int(end) if between.whole else end}))
            others = [note for note in found.notes if note not in setup.notes]
            if others:
                raise ValueError(f"{name} cannot be tuned in this range: {others[0]}")


@contextlib.contextmanager
def _study_in(folder: Path) -> Iterator[None]:
    """Lock a folder for a `with` block, in which errors of Optuna and its database become a ValueError of one line.

    Raises:
        ValueError: Another search uses the folder, or the study cannot be read or written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(str(folder), os.O_RDONLY)
    try:
        have_alone(descriptor, folder, "search")
        yield
    except Exception as error:
        known = ("optuna", "sqlalchemy")  # by name, as they need not be installed
        if type(error).__module__.partition(".")[0] not in known:
            raise
        reason = error if getattr(error, "orig", None) else error.__cause__ or error
        text = str(getattr(reason, "orig", reason)).partition("\n")[0]
        raise ValueError(f"the study in {folder} cannot be read or written: {text}") from error
    finally:
        os.close(descriptor)


def open_study(options: argparse.Namespace, space: Space, setup: Setup, tasks: Sequence[EpisodeTask]) -> Any:
    """Return the study in the output folder, which is created where there is none.

    Raises:
        ValueError: Optuna is not installed, or the study there has other settings; the text names the first.
    """
    try:
        import optuna
    except ImportError as error:
        raise ValueError(f"tuning needs Optuna (python3-optuna): {error}") from error
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    about = {
        "ranges": {name: list(bounds) for name, bounds in space.items()}, "metric": options.metric,
        "seeds": options.seeds, "seed": options.seed, "together": options.together,
        **settings_of(Path(options.worlds).name, tasks, setup),
    }
    file = quote(str((options.out / "study.db").resolve()))  # a path may have characters that are special in a URI
    study = optuna.create_study(
        storage=f"sqlite:///file:{file}?uri=true", study_name="mbf_relay", load_if_exists=True, direction="maximize")
    before, now = study.user_attrs.get("about"), json.loads(json.dumps(about))
    if before is None:
        study.set_user_attr("about", now)
    elif before != now:
        changed = min(name for name in {**before, **now} if before.get(name) != now.get(name))
        raise ValueError(f"{options.out} holds a study with other {changed}; choose another --out")
    return study


def changes_of(parameters: Parameters) -> List[str]:
    """Return parameters as changes "a.b=c", with values written as YAML: Python's 1e-05 would be read as a string."""
    return [f"{name}={yaml.safe_dump(value).split()[0]}" for name, value in parameters.items()]


def write_best(folder: Path, setup: Setup) -> None:
    """Write all parameters of a setup that differ from the package's files: the user's own and the tuned ones.

    Args:
        folder: Gets `best.yaml`, with the nodes' names as its first level, and a folder `best` with a file per node.
        setup: The best setup.
    """
    nodes = own_part(setup.settings, load_settings(config_folder()))
    (folder / "best").mkdir(parents=True, exist_ok=True)
    write_whole(folder / "best.yaml", yaml.safe_dump(nodes))
    for node, values in nodes.items():
        write_whole(folder / "best" / f"{node}.yaml", yaml.safe_dump(values))


def verdict(
    unseen: Sequence[EpisodeTask], best: Parameters, drive: TrialDrives, metric: str, is_unseen: bool
) -> str:
    """Test the best parameters against the initial ones, with seeds that were not tuned on; return the result as text.

    Args:
        unseen: The worlds to test on.
        best: The best parameters.
        drive: Drives the episodes.
        metric: The measure that was optimized; tested beside success.
        is_unseen: Whether the worlds were kept from the search.
    """
    others = drive.with_other_seeds([seed + OTHER_SEEDS for seed in drive.seeds])
    before, after = others.results([({}, unseen), (best, unseen)])
    (found,) = contrasts([before, after], list(dict.fromkeys(("success", metric))))
    count = len(others.seeds)
    lines = [f"on {len(unseen)} worlds with {count} seeds each that it was not tuned on:" if is_unseen else
             f"on the same {len(unseen)} worlds, too few to keep any from the tuning, with {count} other seeds each:"]
    lines += [
        f"  {c.measure}: {c.difference.value:+.3f} {c.difference.interval()}, chance {c.chance:.3f}: {c.verdict}"
        for c in found if not math.isnan(c.value.value)
    ]
    return "\n".join(lines)


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    metrics = [measure.name for measure in MEASURES if measure.better]
    parser = argparse.ArgumentParser(prog="tune.py", description="Look for parameters that drive worlds better.")
    parser.add_argument("worlds", metavar="WORLDS", help="a worlds file (JSON), or 'circle'")
    parser.add_argument(
        "--param", action="append", default=[], metavar="A.B=LOW:HIGH", help="tune this parameter; may be repeated")
    parser.add_argument("--space", type=Path, metavar="FILE", help="YAML file of ranges, {A.B: [LOW, HIGH]}")
    parser.add_argument("--trials", type=positive, default=40, metavar="N", help="number of trials (default 40)")
    parser.add_argument(
        "--metric", metavar="NAME", choices=metrics, default="score",
        help=f"what to improve (default score), one of: {'; '.join(metrics)}"
    )
    parser.add_argument(
        "--together", type=positive, default=1, metavar="N",
        help="trials at a time, for more cores than episodes; they do not learn from each other (default 1)",
    )
    parser.add_argument("--seed", type=random_seed, default=1, metavar="N", help="seed of the search (default 1)")
    parser.add_argument("--seeds", type=seeds, default=[1], metavar="N|A-B",
                        help="drive each world with seeds 1 to N, or A to B (default 1)")
    add_setup_options(parser)
    add_worker_options(parser)
    parser.add_argument(
        "--out", type=Path, default=Path("tuned"), metavar="DIR", help="folder for the study and the best parameters")
    return parser.parse_args(arguments)
