"""The compare command: results of batches, paired by world and seed."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import List, Optional, Sequence

from mbf_relay import statistics
from mbf_relay.lockstep import compare_many
from mbf_relay.lockstep.command import or_null, without_remappings
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.results_file import LINES, WORLDS, other_worlds, read_lines, read_settings
from mbf_relay.lockstep.summary import MEASURES, Comparison, compare
from mbf_relay.simulation.worlds_file import load_difficulties
from mbf_relay.statistics import IntervalEstimate
from mbf_relay.whole_files import write_whole

MOST_NAMES = 5
"""Worlds named in a warning; the others are left out."""


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command; return its exit status: 0, or 1 where there is nothing to compare."""
    parser = argparse.ArgumentParser(prog="compare.py", description="Set the results of batches side by side.")
    parser.add_argument("first", metavar="A", type=Path, help="folder (or episodes.jsonl) of the batch to compare with")
    parser.add_argument(
        "others", metavar="B", type=Path, nargs="+", help="folders of other batches; each is compared with A"
    )
    parser.add_argument("--json", metavar="FILE", type=Path, help="also write the comparison of A and B to this file")
    parser.add_argument(
        "--plot", metavar="FILE", type=Path, help="draw success against difficulty into this file; needs --worlds")
    parser.add_argument("--worlds", metavar="FILE", type=Path, help="worlds file with the difficulties")
    parser.add_argument(
        "--by", metavar="MEASURE", default="path_length_ratio",
        help="measure of difficulty for --plot (default %(default)s)")
    options = parser.parse_args(without_remappings(sys.argv[1:] if arguments is None else arguments))
    if options.plot and options.worlds is None:
        parser.error("--plot needs --worlds FILE, the worlds file that states how hard its worlds are")
    try:
        paths = [options.first, *options.others]
        batches = [_read(path) for path in paths]
        for path in paths[1:]:
            _tell_other_worlds(paths[0], path)
        if len(batches) > 2:
            print(compare_many.as_table([str(path) for path in paths], batches))
        if len(batches) == 2 or options.json:
            _two(paths, batches, options.json)
        if options.plot:
            _plot(options, paths, batches)
    except (OSError, ValueError) as error:
        print(f"compare.py: {error}", file=sys.stderr)
        return 1
    return 0


def _two(paths: Sequence[Path], batches: Sequence[List[EpisodeResult]], json_file: Optional[Path]) -> None:
    """Print, and write as JSON, how the second batch differs from the first."""
    comparison = compare(batches[0], batches[1])
    if not comparison.pairs:
        raise ValueError(f"{paths[0]} and {paths[1]} share no world and seed; drive the same worlds twice")
    if len(batches) == 2:
        print(_settings_that_differ(paths[0], paths[1]))
        print(as_text(comparison))
    if json_file:
        write_whole(json_file, as_json(comparison))


def _plot(options: argparse.Namespace, paths: Sequence[Path], batches: Sequence[List[EpisodeResult]]) -> None:
    known = load_difficulties(options.worlds)
    compare_many.plot(options.plot, [str(path) for path in paths], batches, known, options.by)


def as_text(comparison: Comparison) -> str:
    """Return the comparison as a table, with the episodes that only one of the batches brought to success."""
    lines = [
        f"{comparison.pairs} pairs of episodes (same world, same seed); differences are B less A with 95 % intervals"
    ]
    if comparison.only_first or comparison.only_second:
        lines.append(
            f"left out: {comparison.only_first} episodes that only A has, {comparison.only_second} that only B has"
        )
    lines += ["", f"{'':34}{'A':>9} {'B':>9}   {'B - A':>9}  interval"]
    for measure in MEASURES:
        difference = comparison.differences[measure.name]
        if math.isnan(difference.value):
            continue
        title = measure.name + (f" [{measure.unit}]" if measure.unit else "")
        lines.append(
            f"{title:34}{comparison.first[measure.name].value:9.3f} {comparison.second[measure.name].value:9.3f}   "
            f"{difference.value:+9.3f}  {difference.interval()}{_mark(difference)}"
        )
    lines += ["", "* the interval leaves out zero, as that of one measure in twenty does where nothing differs"]
    if comparison.worlds == 1:
        lines.append("all are of one world: intervals tell of other seeds in that world, and of no other world")
    lines.append(f"brought to success by B alone: {_names(comparison.gained)}")
    lines.append(f"brought to success by A alone: {_names(comparison.lost)}")
    needed = statistics.least_groups(compare_many.SURE)
    few = f"; {compare_many.too_few(comparison.worlds, needed)}" if comparison.worlds < needed else ""
    lines.append(f"chance of so uneven a split if both were equally good: {comparison.chance:.3f}{few}")
    return "\n".join(lines)


def as_json(comparison: Comparison) -> str:
    """Return the comparison as JSON; what was not measured is null."""
    values = {
        "pairs": comparison.pairs,
        "worlds": comparison.worlds,
        "only_first": comparison.only_first,
        "only_second": comparison.only_second,
        "measures": {
            measure.name: {
                "unit": measure.unit,
                "first": or_null(comparison.first[measure.name]),
                "second": or_null(comparison.second[measure.name]),
                "difference": or_null(comparison.differences[measure.name]),
            }
            for measure in MEASURES
        },
        "gained": comparison.gained,
        "lost": comparison.lost,
        "chance": comparison.chance,
    }
    return json.dumps(values, indent=1) + "\n"


def _read(path: Path) -> List[EpisodeResult]:
    results, warnings = read_lines(path / LINES if path.is_dir() or not path.exists() else path)
    if warnings and not results and path.is_file() and path.name != LINES:
        raise ValueError(f"{path} holds no results; give a batch's folder, or the {LINES} in it")
    for warning in warnings:
        print(f"compare.py: {warning}", file=sys.stderr)
    return results


def _settings_that_differ(first: Path, second: Path) -> str:
    """Return a line per setting in which the two batches differ."""
    a, b = read_settings(first), read_settings(second)
    if a is None or b is None:
        return "settings: not known"
    names = sorted(name for name in (set(a) | set(b)) - {WORLDS} if a.get(name) != b.get(name))
    return "\n".join([f"{name}: A {a.get(name)!r}, B {b.get(name)!r}" for name in names] or ["settings: the same"])


def _tell_other_worlds(first: Path, other: Path) -> None:
    """Warn of worlds that have the same name in both batches but differ, so that their episodes are no real pairs."""
    names = other_worlds(read_settings(first), read_settings(other))
    if names:
        more = ", …" if len(names) > MOST_NAMES else ""
        print(f"{other}: {len(names)} worlds are not those of {first}, for all their names: "
              f"{', '.join(names[:MOST_NAMES])}{more}; what is told of them may come of that")


def _mark(difference: IntervalEstimate) -> str:
    return " *" if difference.low > 0.0 or difference.high < 0.0 else ""


def _names(keys: Sequence[Sequence[object]]) -> str:
    return ", ".join(f"{world} (seed {seed})" for world, seed in keys) or "none"
