"""The output of a batch: a summary as text and JSON, tables and pictures."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any, Dict, List, Sequence

from mbf_relay.lockstep import tables
from mbf_relay.lockstep.command import Progress, or_null, say
from mbf_relay.lockstep.episodes import Lost
from mbf_relay.lockstep.options import TIME_LIMIT
from mbf_relay.lockstep.result import ERROR, EpisodeResult
from mbf_relay.lockstep.summary import MEASURES, summarize
from mbf_relay.lockstep.tasks import EpisodeTask
from mbf_relay.lockstep.workers import workers_for
from mbf_relay.whole_files import write_whole

if TYPE_CHECKING:
    from mbf_relay.lockstep import pictures

TILES = 40
"""Tiles of the contact sheet that are one piece of work."""
WORTH_A_PROCESS = 8
"""Pieces of work per process that draws."""


def leave(
    folder: Path, results: Sequence[EpisodeResult], tasks: Sequence[EpisodeTask], processes: int,
    trajectories: bool = False,
) -> None:
    """Write summary, tables and pictures, and print the summary.

    Args:
        folder: Where to write.
        results: In any order; where there are none, nothing is written.
        tasks: Tasks of the worlds; results without a task have no picture.
        processes: Number of processes for drawing.
        trajectories: Also write a file of each drive's trajectory.
    """
    done = sorted(results, key=lambda result: (result.world, result.seed))
    if not done:
        return
    say(as_text(done))
    write_whole(folder / "summary.json", as_json(done))
    tables.write(folder, done, trajectories)
    by_name = {task.name: task for task in tasks}
    made = "results, summary and pictures"
    try:
        lost = draw(folder, [(by_name[result.world], result) for result in done if result.world in by_name], processes)
        if lost:
            print(f"pictures are missing, as {len(lost)} could not be drawn: {lost[0]}", file=sys.stderr)
            made = "results, summary and what could be drawn"
    except ValueError as error:  # a ClusterError, as where the package's files were edited meanwhile
        print(f"no pictures: {error}", file=sys.stderr)
        made = "results and summary"
    say(f"{made} are in {folder}")


def draw(folder: Path, shown: Sequence[pictures.Shown], processes: int) -> List[str]:
    """Draw the contact sheet and a picture of each failure; return the error of each piece that could not be drawn."""
    from mbf_relay.lockstep import pictures  # drives do not need Pillow

    failures = [[pair] for pair in shown if not pair[1].success and pair[1].outcome != ERROR]
    pieces = [list(shown[first:first + TILES]) for first in range(0, len(shown), TILES)]
    count = len(pieces) + len(failures)
    progress = Progress(count)
    lost: List[str] = []
    with workers_for(count, min(processes, count // WORTH_A_PROCESS), say=lambda line: None) as workers:
        firsts = {id(piece): TILES * number for number, piece in enumerate(pieces)}
        sheet = pictures.ContactSheet(len(shown))
        for number, (piece, drawn) in enumerate(workers.run(pictures.tiles, pieces, TIME_LIMIT), 1):
            if isinstance(drawn, Lost):
                lost.append(str(drawn))
            else:
                sheet.put(firsts[id(piece)], drawn)
            progress.show(number, 0.0, "pictures")
        if len(lost) < len(pieces):
            sheet.write(folder / "contact_sheet.png")
        del sheet  # before matplotlib takes as much
        for number, (((_, result),), drawn) in enumerate(workers.run(pictures.failure, failures, TIME_LIMIT), 1):
            if isinstance(drawn, Lost):
                lost.append(str(drawn))
            else:
                write_whole(folder / f"failure-{result.stem}.png", drawn)
            progress.show(len(pieces) + number, 0.0, "pictures")
    return lost


def as_text(results: Sequence[EpisodeResult]) -> str:
    """Return the summary as a table, and a line for each failure with its reason."""
    lines = [f"{len(results)} episodes; means with 95 % intervals"]
    summary = summarize(results)
    for measure in MEASURES:
        estimate = summary[measure.name]
        if estimate.value == estimate.value:
            title = measure.name + (f" [{measure.unit}]" if measure.unit else "")
            lines.append(f"  {title:34} {estimate}")
    for result in results:
        if not result.success:
            lines.append(
                f"  {result.world} (seed {result.seed}): {result.outcome} at {result.time:.1f} s. {result.message}"
            )
    return "\n".join(lines)


def as_json(results: Sequence[EpisodeResult]) -> str:
    """Return the summary as JSON; what was not measured is null."""
    measures = {measure.name: measure for measure in MEASURES}
    values: Dict[str, Any] = {"episodes": len(results)}
    for name, estimate in summarize(results).items():
        value, low, high = or_null(estimate)
        values[name] = {"value": value, "low": low, "high": high, "unit": measures[name].unit}
    return json.dumps(values, indent=1) + "\n"
