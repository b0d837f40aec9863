"""The compare command: two batches side by side, world by world."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import List, Optional, Sequence

from mbf_relay.lockstep.command import finite, without_remappings
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.results_file import LINES, SETTINGS, read_lines
from mbf_relay.lockstep.statistics import Estimate
from mbf_relay.lockstep.summary import MEASURES, Comparison, compare


def main(arguments: Optional[Sequence[str]] = None) -> int:
    """Run the command; return its exit status: 0, or 1 where there is nothing to compare."""
    parser = argparse.ArgumentParser(prog="compare.py", description="Set the results of two batches side by side.")
    parser.add_argument("first", metavar="A", type=Path, help="folder (or episodes.jsonl) of a batch")
    parser.add_argument("second", metavar="B", type=Path, help="folder (or episodes.jsonl) of another one")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write the comparison there, too")
    options = parser.parse_args(without_remappings(sys.argv[1:] if arguments is None else arguments))
    try:
        first, second = _read(options.first), _read(options.second)
        comparison = compare(first, second)
        if not comparison.pairs:
            raise ValueError(f"{options.first} and {options.second} share no world and seed; drive the same worlds twice")
    except ValueError as error:
        print(f"compare.py: {error}", file=sys.stderr)
        return 1
    print(_settings_that_differ(options.first, options.second))
    print(as_text(comparison))
    if options.json:
        options.json.write_text(as_json(comparison), encoding="utf-8")
    return 0


def as_text(comparison: Comparison) -> str:
    """Return the comparison as a table and the worlds that changed sides."""
    lines = [f"{comparison.pairs} pairs of episodes (same world, same seed); differences are B less A with 95 % intervals"]
    if comparison.only_first or comparison.only_second:
        lines.append(f"left out: {comparison.only_first} episodes that only A has, {comparison.only_second} that only B has")
    lines += ["", f"{'':34}{'A':>9} {'B':>9}   {'B - A':>9}  interval"]
    for measure in MEASURES:
        difference = comparison.differences[measure.name]
        if math.isnan(difference.value):
            continue
        title = measure.name + (f" [{measure.unit}]" if measure.unit else "")
        lines.append(
            f"{title:34}{comparison.first[measure.name].value:9.3f} {comparison.second[measure.name].value:9.3f}   "
            f"{difference.value:+9.3f}  [{difference.low:+.3f}, {difference.high:+.3f}]{_mark(difference)}"
        )
    lines += ["", "* the interval leaves out zero"]
    lines.append(f"brought to success by B alone: {_names(comparison.gained)}")
    lines.append(f"brought to success by A alone: {_names(comparison.lost)}")
    lines.append(f"chance of so uneven a split if both were equally good: {comparison.chance:.3f}")
    return "\n".join(lines)


def as_json(comparison: Comparison) -> str:
    """Return the comparison as JSON; what was not measured is null."""
    values = {
        "pairs": comparison.pairs,
        "only_first": comparison.only_first,
        "only_second": comparison.only_second,
        "measures": {
            measure.name: {
                "unit": measure.unit,
                "first": finite(comparison.first[measure.name]),
                "second": finite(comparison.second[measure.name]),
                "difference": finite(comparison.differences[measure.name]),
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
    for warning in warnings:
        print(f"compare.py: {warning}", file=sys.stderr)
    return results


def _settings_that_differ(first: Path, second: Path) -> str:
    """Return a line per setting in which the two batches differ."""
    try:
        a, b = (json.loads((path / SETTINGS).read_text(encoding="utf-8")) for path in (first, second))
    except (OSError, ValueError):
        return "settings: not known"
    names = sorted(name for name in set(a) | set(b) if a.get(name) != b.get(name))
    return "\n".join([f"{name}: A {a.get(name)!r}, B {b.get(name)!r}" for name in names] or ["settings: the same"])


def _mark(difference: Estimate) -> str:
    return " *" if difference.low > 0.0 or difference.high < 0.0 else ""


def _names(keys: Sequence[Sequence[object]]) -> str:
    return ", ".join(f"{world} (seed {seed})" for world, seed in keys) or "none"
