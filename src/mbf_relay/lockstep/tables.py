"""Results as tables for other programs: CSV, Parquet, a NumPy file per drive, and a description of the columns."""

from __future__ import annotations

import csv
import io
import math
from pathlib import Path
from typing import Any, Callable, NamedTuple, Optional, Sequence

import numpy as np

from mbf_relay.lockstep import result as outcomes
from mbf_relay.lockstep.result import CLOSE, PERSONAL_SPACE, EpisodeResult
from mbf_relay.whole_files import whole_file, write_whole

TABLE, PARQUET, TRAJECTORIES, DICTIONARY = "results.csv", "results.parquet", "trajectories", "README.md"
"""Names of the files, and of the folder of trajectories."""

BARN = "Perille et al., Benchmarking Metric Ground Navigation (SSRR 2020), and the BARN challenge's rules"
ANDERSON = "Anderson et al., On Evaluation of Embodied Navigation Agents (2018)"
HAYWARD = "Hayward, Near-miss determination through use of a scale of danger (1972)"
HALL = "Hall, The Hidden Dimension (1966)"
SOCIAL = "Biswas et al., SocNavBench (THRI 2021)"
ARENA = "Kästner et al., Arena-Bench (RA-L 2022)"
FRANCIS = "Francis et al., Principles and Guidelines for Evaluating Social Robot Navigation Algorithms (THRI 2025)"
NAV2 = "Nav2, number_of_recoveries in the feedback of NavigateToPose"
OWN = "this package"


class Column(NamedTuple):
    """A column of the table.

    Attributes:
        name: Name of the column.
        unit: Empty for texts, counts and shares.
        meaning: Description in one line.
        of: Returns its value for a result, or None.
        driven: Whether its cell is empty for episodes that could not be driven (ERROR).
        source: Publication that defines the metric; empty where the column is no metric.
    """

    name: str
    unit: str
    meaning: str
    of: Callable[[EpisodeResult], Any]
    driven: bool = True
    source: str = ""

    def value(self, result: EpisodeResult) -> Any:
        """Return the cell of a result; None for an empty one."""
        return None if self.driven and result.outcome == outcomes.ERROR else self.of(result)


def spl(result: EpisodeResult) -> Optional[float]:
    """Return success weighted by path length (Anderson et al. 2018): success x l / max(p, l).

    l is the length of the reference path and p that of the path driven; None without a reference path.
    """
    if result.reference_path_length is None:
        return None
    best = result.reference_path_length
    return best / max(result.path_length, best) if result.success else 0.0


def _ratio(result: EpisodeResult) -> Optional[float]:
    known = result.success and result.reference_path_length
    return result.path_length / result.reference_path_length if known and result.reference_path_length else None


def _peak(result: EpisodeResult) -> Optional[float]:
    return float(np.abs(result.trajectory[:, 4]).max()) if len(result.trajectory) else None


COLUMNS: Sequence[Column] = (
    Column("world", "", "name of the world", lambda r: r.world, False),
    Column("seed", "", "seed of all chance", lambda r: r.seed, False),
    Column("outcome", "", "SUCCEEDED, CONTACT, TIMEOUT, ERROR (not driven), or how navigation ended",
           lambda r: r.outcome, False),
    Column("success", "", "1 where all goals were reached in time without a contact", lambda r: int(r.success), False,
           ANDERSON),
    Column("collision", "", "1 where the robot touched anything but the ground",
           lambda r: int(r.outcome == outcomes.CONTACT), False, BARN),
    Column("contacts", "", "how often it came to touch something", lambda r: r.contacts, True, FRANCIS),
    Column("contacts_at_fault", "", "of them, those at which it moved towards what it touched, unpushed",
           lambda r: r.contacts_at_fault, True, OWN),
    Column("timeout", "", "1 where time ran out", lambda r: int(r.outcome == outcomes.TIMEOUT), False, BARN),
    Column("spl", "", "success weighted by path length: success x l / max(p, l)", spl, False, ANDERSON),
    Column("barn_score", "", "success x OT / clip(T, 2 OT, 8 OT), OT the reference path at top speed",
           lambda r: r.score, False, BARN),
    Column("time", "s", "time to the end of the drive", lambda r: r.time, True, ARENA),
    Column("path_length", "m", "length of the way driven", lambda r: r.path_length, True, ARENA),
    Column("path_length_ratio", "", "way driven by reference path, of successes", _ratio, True,
           f"{SOCIAL}, which divides by the straight line"),
    Column("velocity_average", "m/s", "way driven by time", lambda r: r.path_length / r.time if r.time else None, True,
           ARENA),
    Column("velocity_peak", "m/s", "greatest forward or backward speed", _peak, True, FRANCIS),
    Column("acceleration", "m/s^2", "mean absolute acceleration along the way",
           lambda r: r.smoothness.mean_acceleration, True, ARENA),
    Column("jerk", "m/s^3", "mean absolute change of it", lambda r: r.smoothness.mean_jerk, True, SOCIAL),
    Column("angular_jerk", "rad/s^3", "mean absolute change of the angular acceleration",
           lambda r: r.smoothness.mean_angular_jerk, True, ARENA),
    Column("turn_changes", "1/m", "how often the turning changed sides", lambda r: r.smoothness.turn_changes_per_metre,
           True, OWN),
    Column("standing", "", "share of the time in which it neither drove nor turned",
           lambda r: r.smoothness.standing_share, True, f"{FRANCIS}: stalled time, here by the whole"),
    Column("clearance_smallest", "m", "least distance between hull and anything", lambda r: r.smallest_clearance, True,
           ARENA),
    Column("clearance_mean", "m", "mean distance between hull and what is nearest", lambda r: r.mean_clearance, True,
           FRANCIS),
    Column("close_time", "s", f"time with less than {CLOSE:g} m between hull and anything",
           lambda r: r.close_time, True, OWN),
    Column("closest_approach", "m", "least distance between hull and anything that moves by itself",
           lambda r: r.closest_approach, True, SOCIAL),
    Column("time_to_collision", "s", "least time to meeting what moves by itself, had both gone on closing in",
           lambda r: r.time_to_collision, True, HAYWARD),
    Column("personal_space_time", "s", f"time within {PERSONAL_SPACE:g} m of anything that moves by itself",
           lambda r: r.personal_space_time, True, HALL),
    Column("recoveries", "", "recovery behaviours begun", lambda r: r.recoveries, True, NAV2),
    Column("goals_reached", "", "goals reached, in order", lambda r: r.goals_reached, False, OWN),
    Column("goals", "", "goals asked for", lambda r: r.goals, True),
    Column("final_error", "m", "distance from the last goal at the end", lambda r: r.final_error, True, OWN),
    Column("localization_error_mean", "m", "mean distance between true and believed position",
           lambda r: r.localization_error_mean, True, OWN),
    Column("localization_error_max", "m", "greatest of it", lambda r: r.localization_error_max, True, OWN),
    Column("wall_time", "s", "time the computer took; depends on the machine", lambda r: r.machine.get("wall"), False),
    Column("message", "", "why it ended so", lambda r: r.message, False),
    Column("digest", "", "hash over the drive: equal digests are equal drives", lambda r: r.digest),
)


def write(folder: Path, results: Sequence[EpisodeResult], trajectories: bool = False) -> None:
    """Write the tables.

    Args:
        folder: Where to write.
        results: The rows.
        trajectories: Also write a file of each drive's trajectory.
    """
    rows = io.StringIO(newline="")
    writer = csv.writer(rows)
    writer.writerow(column.name for column in COLUMNS)
    writer.writerows([_cell(column.value(result)) for column in COLUMNS] for result in results)
    write_whole(folder / TABLE, rows.getvalue())
    _write_parquet(folder / PARQUET, results)
    if trajectories:
        (folder / TRAJECTORIES).mkdir(exist_ok=True)
        for result in results:
            _write_trajectory(folder / TRAJECTORIES / f"{result.stem}.npz", result)
    write_whole(folder / DICTIONARY, dictionary())


def dictionary() -> str:
    """Return the description of all columns, as Markdown."""
    lines = [
        "# Results of a batch", "",
        f"`{TABLE}` (and `{PARQUET}` where pyarrow is there) has a row per episode, `episodes.jsonl` all of it;",
        "an empty cell was not measured. A trajectory's file has `time` (s), `truth` and `believed` (x, y in m, yaw in",
        "rad) and `velocity` (m/s forward, rad/s).", "",
        "| column | unit | meaning | defined by |", "|---|---|---|---|",
    ]
    lines += [f"| `{c.name}` | {c.unit} | {c.meaning} | {c.source} |" for c in COLUMNS]
    return "\n".join(lines) + "\n"


def _cell(value: Any) -> Any:
    return "" if value is None or isinstance(value, float) and not math.isfinite(value) else value


def _write_parquet(path: Path, results: Sequence[EpisodeResult]) -> None:
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        return
    columns = {column.name: [column.value(result) for result in results] for column in COLUMNS}
    with whole_file(path) as stream:
        parquet.write_table(pyarrow.table(columns), stream)


def _write_trajectory(path: Path, result: EpisodeResult) -> None:
    rows = result.trajectory
    with whole_file(path) as stream:
        np.savez_compressed(
            stream, time=rows[:, 0], truth=rows[:, 1:4], velocity=rows[:, 4:6], believed=result.believed)
