"""The report as one self-contained HTML file: picture, metrics, goals, versions and parameters."""

from __future__ import annotations

import base64
import html
from typing import Any, Iterable, List, Mapping, Tuple

from mbf_relay.report.drive import Drive
from mbf_relay.report.picture import headline
from mbf_relay.whole_files import write_whole

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #212529; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.15rem; margin-top: 2rem; }
img { width: 100%; border: 1px solid #dee2e6; border-radius: 6px; }
table { border-collapse: collapse; }
td, th { padding: .25rem .8rem; border-bottom: 1px solid #e9ecef; text-align: left; }
td.number { text-align: right; font-variant-numeric: tabular-nums; } .good { color: #2b8a3e; } .bad { color: #c92a2a; }
code, td.value { font-family: ui-monospace, monospace; font-size: 13px; } summary { cursor: pointer; }
"""
FIGURES: Tuple[Tuple[str, str, str], ...] = (
    ("goals_reached", "goals reached", ""),
    ("goals_asked", "goals asked", ""),
    ("contacts", "contacts", ""),
    ("recoveries", "recovery behaviours", ""),
    ("sim_time", "time in the world", "s"),
    ("wall_time", "time on the wall clock", "s"),
    ("path_length", "driven", "m"),
    ("localization_error_mean", "localization error, mean", "m"),
    ("localization_error_max", "localization error, largest", "m"),
    ("heading_error_mean", "heading error, mean", "rad"),
    ("heading_error_max", "heading error, largest", "rad"),
    ("seed", "seed", ""),
)


def write(drive: Drive, path: str, picture: bytes) -> None:
    """Write the report of a drive as one self-contained HTML file.

    Args:
        drive: The drive.
        path: File to write.
        picture: Picture of the drive (PNG).

    Raises:
        OSError: It cannot be written.
    """
    write_whole(path, render(drive, base64.b64encode(picture).decode("ascii")))


def render(drive: Drive, picture: str) -> str:
    """Return the page's HTML; `picture` is a PNG in base64."""
    figures = drive.summary()
    verdict = ("good", "All goals reached, nothing touched.") if figures["success"] else ("bad", "Not a clean drive.")
    parts = [
        "<!DOCTYPE html><html lang='en'><head><meta charset='utf-8'><title>Drive report</title>",
        f"<style>{STYLE}</style></head><body><h1>{html.escape(headline(drive))}</h1>",
        f"<p class='{verdict[0]}'>{verdict[1]}</p>",
        f"<img alt='map and course of the drive' src='data:image/png;base64,{picture}'>",
        "<h2>Figures</h2>",
        _table(("figure", "value", "unit"), [(name, _show(figures[key]), unit) for key, name, unit in FIGURES]),
        "<h2>Goals</h2>",
        _table(
            ("goal", "x [m]", "y [m]", "heading [rad]", "ended", "time [s]", "recoveries", "text"), _goal_rows(drive)
        ),
        "<h2>Versions</h2>",
        _table(("what", "version"), sorted(drive.versions.items())),
        "<h2>Parameters</h2>",
        "".join(_parameters(name, values) for name, values in sorted(drive.parameters.items())),
        "</body></html>\n",
    ]
    return "\n".join(parts)


def _goal_rows(drive: Drive) -> Iterable[Tuple[Any, ...]]:
    for number, goal in enumerate(drive.goals, 1):
        time = "" if goal.ended is None else f"{goal.ended - goal.started:.1f}"
        pose = tuple(f"{value:.3f}" for value in goal.pose)
        yield (number, *pose, goal.state, time, ", ".join(goal.recoveries), goal.text)


def _parameters(name: str, values: Any) -> str:
    rows = _flatten("", values) if isinstance(values, Mapping) else [("", str(values))]
    return f"<details><summary>{html.escape(name)}</summary>{_table(('parameter', 'value'), rows)}</details>"


def _flatten(prefix: str, values: Mapping[str, Any]) -> List[Tuple[str, str]]:
    rows: List[Tuple[str, str]] = []
    for name, value in sorted(values.items()):
        if isinstance(value, Mapping):
            rows.extend(_flatten(f"{prefix}{name}/", value))
        else:
            rows.append((prefix + name, str(value)))
    return rows


def _table(titles: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    head = "".join(f"<th>{html.escape(title)}</th>" for title in titles)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(str(cell))}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _show(value: Any) -> str:
    if value is None:
        return "not known"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
