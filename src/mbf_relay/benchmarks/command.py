"""The benchmark command: runs the benchmarks asked for and shows their figures as a table and as JSON."""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import json
import sys
import traceback
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

from mbf_relay.benchmarks import NAMES
from mbf_relay.benchmarks.figure import Figure, NotMeasurable, describe_machine, machine_line, table
from mbf_relay.benchmarks.readme import rewrite_section
from mbf_relay.lockstep.command import without_remappings
from mbf_relay.parameters import did_you_mean, nearest_of

Results = List[Tuple[str, Figure]]


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command; return its exit status: 0, or 1 where a benchmark failed."""
    options = _parse(arguments)
    if options.taken:
        try:
            machine, results = read_taken(options.taken)
        except (OSError, ValueError, KeyError, TypeError) as error:
            sys.exit(f"benchmark.py: no figures in {', '.join(options.taken)}: {error}")
        failed: List[str] = []
    else:
        machine = describe_machine()
        print(machine_line(machine), flush=True)
        results, failed = run(options.names or available(), options.quick)
    for name in dict.fromkeys(name for name, _ in results):
        print(f"\n{name}\n{table([figure for benchmark, figure in results if benchmark == name])}")
    if options.json:
        Path(options.json).write_text(as_json(machine, results), encoding="utf-8")
        print(f"figures written to {options.json}")
    if options.readme:
        readme = Path(options.readme)
        readme.write_text(rewrite_section(readme.read_text(encoding="utf-8"), machine, results), encoding="utf-8")
        print(f"figures written into {options.readme}")
    for name in failed:
        print(f"benchmark {name} failed: see above", file=sys.stderr)
    return 1 if failed else 0


def run(names: Sequence[str], quick: bool) -> Tuple[Results, List[str]]:
    """Run benchmarks one after the other, telling each figure as it is taken.

    Returns:
        The figures, each with its benchmark's name, and the names of the benchmarks that ended in an exception.
    """
    results: Results = []
    failed = []
    for name in names:
        try:
            module = importlib.import_module(f"mbf_relay.benchmarks.{name}")
            for figure in module.figures(quick):
                results.append((name, figure))
                print(f"  {name}: {figure.name}: {figure.value:.4g} {figure.unit}", file=sys.stderr, flush=True)
        except NotMeasurable as reason:
            print(f"benchmark {name} is left out: {reason}", file=sys.stderr)
        except Exception:  # one broken benchmark must not cost the figures of the others
            traceback.print_exc()
            failed.append(name)
    return results, failed


def available() -> List[str]:
    """Return the names of the benchmarks that are part of this installation."""
    return [name for name in NAMES if importlib.util.find_spec(f"mbf_relay.benchmarks.{name}")]


def as_json(machine: Dict[str, Any], results: Results) -> str:
    """Return the machine and one object per figure as JSON."""
    figures = [{"benchmark": name, **figure.as_dict()} for name, figure in results]
    return json.dumps({"machine": machine, "figures": figures}, indent=1) + "\n"


def read_taken(paths: Sequence[str]) -> Tuple[Dict[str, Any], Results]:
    """Return the machine and the figures of files that `--json` wrote, in the benchmarks' order; of one machine only.

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
        results += [(figure.pop("benchmark"), Figure(**figure)) for figure in content["figures"]]
    return machine, sorted(results, key=lambda result: NAMES.index(result[0]))


def _parse(arguments: Optional[Sequence[str]]) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="benchmark.py", description="Measure this package and show the figures as a table."
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(NAMES)}; all where none is given")
    parser.add_argument("--json", metavar="FILE", help="write the figures and the machine there")
    parser.add_argument("--taken", metavar="FILE", nargs="+", help="show the figures in these --json files; measure nothing")
    parser.add_argument("--quick", action="store_true", help="fewer repeats and smaller cases, for a first look")
    parser.add_argument(
        "--readme", metavar="FILE", nargs="?", const="README.md", help="rewrite the table in the README (default README.md)"
    )
    options = parser.parse_args(without_remappings(sys.argv[1:] if arguments is None else arguments))
    for name in options.names:
        if name not in NAMES:
            hint = did_you_mean(nearest_of(name, NAMES))
            parser.error(f"there is no benchmark '{name}' (available: {', '.join(NAMES)}){hint}")
    return options
