"""The picture of a drive: map with plan, true and estimated trajectory; errors and speeds over time."""

from __future__ import annotations

from typing import Any, BinaryIO, Optional, Tuple, Union

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.patches import Circle

from mbf_relay.maps import OCCUPIED, UNKNOWN, OccupancyMap
from mbf_relay.report.drive import Drive

PLAN, TRUTH, ESTIMATE, GOAL, BAD, LIMIT = "#9ec9ff", "#1a1a1a", "#e8590c", "#2b8a3e", "#c92a2a", "#868e96"
"""Colours; LIMIT is also that of secondary data."""


def draw(drive: Drive, target: Union[str, BinaryIO], dpi: int = 110) -> None:
    """Write the picture of a drive as PNG.

    Args:
        drive: The drive.
        target: Path, or open file, to write.
        dpi: Pixels per inch; the picture has 14 x 8 inches.
    """
    figure = Figure(figsize=(14.0, 8.0), facecolor="white")
    FigureCanvasAgg(figure)
    layout = GridSpec(
        3,
        2,
        figure=figure,
        width_ratios=(1.35, 1.0),
        left=0.05,
        right=0.945,
        top=0.89,
        bottom=0.07,
        wspace=0.14,
        hspace=0.42,
    )
    figure.suptitle(headline(drive), x=0.05, y=0.965, ha="left", fontsize=15, fontweight="bold")
    draw_map(figure.add_subplot(layout[:, 0]), drive)
    _draw_error(figure.add_subplot(layout[0, 1]), drive)
    draw_speed(figure.add_subplot(layout[1, 1]), drive, 1, "forward speed", "m/s")
    draw_speed(figure.add_subplot(layout[2, 1]), drive, 2, "turn rate", "rad/s")
    figure.savefig(target, dpi=dpi, format="png")


def headline(drive: Drive) -> str:
    """Return the drive in one line."""
    figures = drive.summary()
    touches = {0: "no contact", 1: "1 contact"}.get(figures["contacts"], f"{figures['contacts']} contacts")
    parts = [
        f"{figures['goals_reached']} of {figures['goals_asked']} goals",
        f"{figures['path_length']:.1f} m in {figures['sim_time']:.0f} s",
        touches,
    ]
    if figures["localization_error_mean"] is not None:
        mean, largest = 100 * figures["localization_error_mean"], 100 * figures["localization_error_max"]
        parts.append(f"localization off by {mean:.1f} cm (at most {largest:.1f} cm)")
    return "  ·  ".join(parts)


def draw_map(axes: Any, drive: Drive) -> None:
    """Draw map, plans, truth, estimate, goals and contacts into a matplotlib axes."""
    if drive.map is not None:
        _draw_occupancy(axes, drive.map)
    elif len(drive.seen):
        axes.plot(drive.seen[:, 0], drive.seen[:, 1], ",", color=LIMIT, label="seen by the lidar")
    for index, (_, poses) in enumerate(_plans_worth_drawing(drive)):
        axes.plot(poses[:, 0], poses[:, 1], color=PLAN, linewidth=3.0, alpha=0.7, label=None if index else "plan")
    if len(drive.truth):
        axes.plot(drive.truth[:, 1], drive.truth[:, 2], color=TRUTH, linewidth=1.6, label="driven (truth)")
    if len(drive.estimate):
        estimate = drive.within_span(drive.estimate)
        axes.plot(estimate[:, 1], estimate[:, 2], color=ESTIMATE, linewidth=1.1, linestyle="--", label="estimated")
    _draw_goals(axes, drive)
    for index, contact in enumerate(drive.contacts):
        axes.plot(contact.x, contact.y, "x", color=BAD, markersize=12, markeredgewidth=3,
                  label=None if index else "contact")
    if len(drive.path):
        axes.plot(*drive.path[0, 1:3], "o", color=TRUTH, markersize=6, label="start")
    _frame(axes, drive)


def _draw_occupancy(axes: Any, occupancy: OccupancyMap) -> None:
    data = occupancy.data
    shades = np.where(data == UNKNOWN, 0.86, 1.0 - 0.75 * np.clip(data, 0, OCCUPIED) / float(OCCUPIED))
    height, width = data.shape
    extent = (0.0, width * occupancy.resolution, 0.0, height * occupancy.resolution)
    image = axes.imshow(shades, cmap="gray", vmin=0.0, vmax=1.0, origin="lower", extent=extent, interpolation="nearest")
    from matplotlib.transforms import Affine2D

    placed = Affine2D().rotate(occupancy.origin.theta).translate(occupancy.origin.x, occupancy.origin.y)
    image.set_transform(placed + axes.transData)


def _plans_worth_drawing(drive: Drive) -> list:
    # Replanning gives hundreds of overlapping plans: only the first one of each goal is drawn.
    plans = []
    for goal in drive.goals:
        last = goal.ended if goal.ended is not None else np.inf
        own = [plan for plan in drive.plans if goal.started <= plan[0] <= last and len(plan[1])]
        plans.extend(own[:1])
    return plans or [plan for plan in drive.plans if len(plan[1])][:1]


def _draw_goals(axes: Any, drive: Drive) -> None:
    for number, goal in enumerate(drive.goals, 1):
        colour = GOAL if goal.reached else BAD
        axes.add_patch(Circle((goal.pose.x, goal.pose.y), 0.09, color=colour, zorder=5))
        tip = 0.22 * np.array([np.cos(goal.pose.theta), np.sin(goal.pose.theta)])
        axes.annotate("", xy=(goal.pose.x + tip[0], goal.pose.y + tip[1]), xytext=(goal.pose.x, goal.pose.y),
                      arrowprops=dict(arrowstyle="-|>", color=colour, linewidth=1.8), zorder=4)
        axes.text(goal.pose.x, goal.pose.y, str(number), color="white", fontsize=8, fontweight="bold", ha="center",
                  va="center", zorder=6)
        words = goal.state.lower() if goal.ended is None or not goal.reached else f"{goal.ended - goal.started:.1f} s"
        axes.annotate(words, xy=(goal.pose.x, goal.pose.y), xytext=(9, -11), textcoords="offset points", fontsize=8,
                      color=colour, zorder=6)


def _frame(axes: Any, drive: Drive) -> None:
    axes.set_aspect("equal")
    limits = _limits(drive)
    if limits is not None:
        axes.set_xlim(limits[0], limits[1])
        axes.set_ylim(limits[2], limits[3])
    axes.set_xlabel("x in map [m]")
    axes.set_ylabel("y in map [m]")
    axes.legend(loc="upper right", fontsize=9, framealpha=0.92)


def _limits(drive: Drive) -> Optional[Tuple[float, float, float, float]]:
    parts = [drive.path[:, 1:3]] + [np.array([goal.pose[:2]]) for goal in drive.goals]
    points = np.concatenate(parts) if any(len(part) for part in parts) else np.empty((0, 2))
    if not len(points):
        return None
    low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
    return low[0], high[0], low[1], high[1]


def _draw_error(axes: Any, drive: Drive) -> None:
    errors = drive.localization_errors()
    axes.set_title("localization error", loc="left", fontsize=11, pad=14)
    axes.set_ylabel("cm")
    if not len(errors):
        axes.text(0.5, 0.5, "no ground truth recorded", ha="center", va="center", transform=axes.transAxes, color=LIMIT)
        return
    start = drive.span[0]
    axes.plot(errors[:, 0] - start, 100.0 * errors[:, 1], color=ESTIMATE, linewidth=1.2, label="position")
    axes.set_ylim(bottom=0.0)
    turned = axes.twinx()
    turned.plot(errors[:, 0] - start, np.degrees(errors[:, 2]), color=LIMIT, linewidth=0.9, alpha=0.8)
    turned.set_ylim(bottom=0.0)
    turned.set_ylabel("heading [deg]", color=LIMIT)
    _mark_goals(axes, drive)


def draw_speed(axes: Any, drive: Drive, column: int, name: str, unit: str) -> None:
    """Draw a commanded and measured speed over time.

    Args:
        axes: matplotlib axes to draw into.
        drive: The drive.
        column: Column of `Drive.commands` and `Drive.measured`: 1 for forward speed, 2 for turn rate.
        name, unit: For title and axis.
    """
    start = drive.span[0]
    limits = () if drive.speed_limits is None else (drive.speed_limits[column - 1],)
    dotted = ", limit dotted" if limits else ""
    axes.set_title(f"{name}: asked and driven{dotted}", loc="left", fontsize=11, pad=14)
    axes.set_ylabel(unit)
    highest = max(limits, default=0.0)
    for rows, colour, width in ((drive.commands, PLAN, 2.2), (drive.measured, TRUTH, 0.9)):
        rows = drive.within_span(rows)
        if len(rows):
            axes.plot(rows[:, 0] - start, rows[:, column], color=colour, linewidth=width)
            highest = max(highest, float(np.abs(rows[:, column]).max()))
    for limit in limits:
        axes.axhline(limit, color=BAD, linewidth=1.0, linestyle=":")
        axes.axhline(-limit, color=BAD, linewidth=1.0, linestyle=":")
    highest = highest or 1.0  # where nothing moved
    axes.set_ylim(-1.15 * highest, 1.15 * highest)
    _mark_goals(axes, drive)
    if column == 2:
        axes.set_xlabel("time since the first goal [s]")


def _mark_goals(axes: Any, drive: Drive) -> None:
    start = drive.span[0]
    for number, goal in enumerate(drive.goals, 1):
        if goal.ended is not None:
            axes.axvline(goal.ended - start, color=GOAL if goal.reached else BAD, linewidth=0.8, alpha=0.6)
            axes.annotate(str(number), xy=(goal.ended - start, 1.0), xycoords=("data", "axes fraction"), xytext=(0, 2),
                          textcoords="offset points", ha="center", fontsize=7, color=GOAL if goal.reached else BAD)
    axes.grid(color="#e9ecef", linewidth=0.8)
    axes.margins(x=0.01)
