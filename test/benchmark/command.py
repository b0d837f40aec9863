"""The benchmark command: runs the benchmarks asked for and shows their metrics as a table and as JSON."""

from __future__ import annotations

import argparse
import importlib
import json
import multiprocessing
import os
import sys
import traceback
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence, Tuple

from benchmark import NAMES, ONLY_BY_NAME
from benchmark.metric import Metric, NotMeasurable, describe_machine, machine_line, table
from benchmark.report import HEADLINES, write_sections
from mbf_relay.misspelling import did_you_mean, nearest_of

Results = List[Tuple[str, Metric]]


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command; return its exit status: 0, or 1 where a benchmark failed."""
    options = _parse(arguments)
    if options.taken:
        try:
            machine, results = read_taken(options.taken)
        except (OSError, ValueError, KeyError, TypeError) as error:
            sys.exit(f"benchmark: no metrics in {', '.join(options.taken)}: {error}")
        failed: List[str] = []
    else:
        machine = describe_machine()
        names = list(dict.fromkeys(["yardstick", *options.names]))
        print(machine_line(machine), flush=True)
        results, failed = run(names, options.quick)
    for name in dict.fromkeys(name for name, _ in results):
        print(f"\n{name}\n{table([metric for benchmark, metric in results if benchmark == name])}")
    if options.json:
        Path(options.json).write_text(as_json(machine, results), encoding="utf-8")
        print(f"metrics written to {options.json}")
    is_written = not options.write or _write_into_readmes(machine, results)
    for name in failed:
        print(f"benchmark {name} failed: see above", file=sys.stderr)
    return 1 if failed or not is_written else 0


def _write_into_readmes(machine: Dict[str, Any], results: Results) -> bool:
    """Write the tables into the READMEs; return False where a metric is missing, and leave them as they are."""
    try:
        for path in write_sections(machine, results):
            print(f"metrics written into {path}")
    except ValueError as error:
        print(f"benchmark: the READMEs are left as they are: {error}", file=sys.stderr)
        return False
    return True


class Taken(NamedTuple):
    """What came of one benchmark: its metrics, and where it did not get to its end, why."""

    metrics: List[Metric]
    left_out: str = ""
    failure: str = ""


def take(name: str, quick: bool) -> Taken:
    """Run one benchmark here, telling each metric as it is taken; what was taken before a failure counts."""
    taken: List[Metric] = []
    try:
        for metric in importlib.import_module(f"benchmark.{name}").metrics(quick):
            taken.append(metric)
            print(f"  {name}: {metric.name}: {metric.value:.4g} {metric.unit}", file=sys.stderr, flush=True)
    except NotMeasurable as reason:
        return Taken(taken, left_out=str(reason))
    except Exception:  # one broken benchmark must not cost the metrics of the others
        return Taken(taken, failure=traceback.format_exc())
    return Taken(taken)


def take_in_fresh_process(name: str, quick: bool) -> Taken:
    """Run one benchmark where no other has left anything: caches, memory, a ROS node's name."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as process:
        try:
            return process.submit(take, name, quick).result()
        except BrokenProcessPool:
            return Taken([], failure=f"the process of benchmark {name} was killed\n")


def run(
    names: Sequence[str], quick: bool, take_one: Callable[[str, bool], Taken] = take_in_fresh_process
) -> Tuple[Results, List[str]]:
    """Run benchmarks one after the other.

    Args:
        names: Of the benchmarks.
        quick: Whether to repeat less and take smaller cases.
        take_one: How to run one.

    Returns:
        The metrics, each with its benchmark's name, and the names of the benchmarks that failed.
    """
    results: Results = []
    failed = []
    for name in names:
        taken = take_one(name, quick)
        results += [(name, metric) for metric in taken.metrics]
        if taken.left_out:
            print(f"benchmark {name} is left out: {taken.left_out}", file=sys.stderr)
        if taken.failure:
            print(taken.failure, end="", file=sys.stderr)
            failed.append(name)
    return results, failed


def as_json(machine: Dict[str, Any], results: Results) -> str:
    """Return the machine and one object per metric as JSON."""
    metrics = [{"benchmark": name, **metric.as_dict()} for name, metric in results]
    return json.dumps({"machine": machine, "metrics": metrics}, indent=1) + "\n"


def read_taken(paths: Sequence[str]) -> Tuple[Dict[str, Any], Results]:
    """Return the machine and the metrics of files that `--json` wrote, in the benchmarks' order; of one machine only.

    Raises:
        OSError, ValueError, KeyError, TypeError: A file cannot be read, or is none of these, or of another machine.
    """
    machine: Dict[str, Any] = {}
    results: Results = []
    for path in paths:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
        if machine and content["machine"] != machine:
            raise ValueError(f"{path} was taken on another machine than {paths[0]}")
        machine = content["machine"]
        results += [(metric.pop("benchmark"), Metric(**metric)) for metric in content["metrics"]]
    return machine, sorted(results, key=lambda result: NAMES.index(result[0]))


def _parse(arguments: Optional[Sequence[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="benchmark", description="Measure this package and show the metrics as a table."
    )
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"of {', '.join(NAMES)}; all but {', '.join(ONLY_BY_NAME)} where none is given",
    )
    parser.add_argument("--json", metavar="FILE", help="write the metrics and the machine there")
    parser.add_argument(
        "--taken", metavar="FILE", nargs="+", help="show the metrics in these --json files; measure nothing"
    )
    parser.add_argument("--quick", action="store_true", help="fewer repeats and smaller cases, for a first look")
    parser.add_argument("--write", action="store_true", help="write the tables into the READMEs")
    options = parser.parse_args(arguments)
    for name in options.names:
        if name not in NAMES:
            hint = did_you_mean(nearest_of(name, NAMES))
            parser.error(f"there is no benchmark '{name}' (available: {', '.join(NAMES)}){hint}")
    if options.json:
        place = Path(options.json).absolute()
        if place.is_dir() or not os.access(str(place.parent), os.W_OK):
            parser.error(f"--json {options.json} cannot be written: give a file in a folder that can")
    options.names = options.names or [name for name in NAMES if name not in ONLY_BY_NAME]
    stated = {headline.benchmark for headline in HEADLINES}.intersection(options.names)
    if options.quick and options.write and not options.taken and stated:
        parser.error("a first look takes smaller cases than the README states figures of: leave out --quick or --write")
    return options
