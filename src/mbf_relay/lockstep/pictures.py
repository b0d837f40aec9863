"""Pictures of episodes: a contact sheet of all, and a larger one of each failure."""

from __future__ import annotations

import math
from io import BytesIO
from pathlib import Path
from typing import List, Sequence, Tuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from mbf_relay.geometry import Pose2D
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.tasks import EpisodeTask
from mbf_relay.report.drive import SUCCEEDED, ContactRecord, Drive, GoalRecord
from mbf_relay.whole_files import write_whole

TILE, CAPTION, GAP = 220, 34, 6
"""Pixels: side of a tile's picture, height of its caption, space between tiles."""

WALL, WAY, TRACK, START, GOAL, BAD, INK = (
    (60, 60, 60),
    (220, 170, 170),
    (30, 110, 200),
    (30, 110, 200),
    (43, 138, 62),
    (201, 42, 42),
    (40, 40, 40),
)
"""Colours (RGB) of walls, movers' ways, trajectory, start, goals reached, what failed, and text."""
FINER = 4
"""Factor by which tiles are drawn larger and then averaged (antialiasing, which Pillow's lines lack)."""
HEIGHT = 0.1
"""Height (m) above the ground at which the world is cut for the picture."""

Shown = Tuple[EpisodeTask, EpisodeResult]
"""An episode to draw."""


class ContactSheet:
    """One picture of all episodes' tiles, wider than high. Tiles are put in as they come: thousands take gigabytes."""

    def __init__(self, count: int) -> None:
        """Begin a white sheet with room for `count` tiles, 1 or more."""
        self._columns = max(1, math.ceil(math.sqrt(1.6 * count)))
        rows = math.ceil(count / self._columns)
        self._sheet = Image.new(
            "RGB", (self._columns * (TILE + GAP) + GAP, rows * (TILE + CAPTION + GAP) + GAP), "white")

    def put(self, first: int, drawn: Sequence[np.ndarray]) -> None:
        """Put tiles (see `tile`) side by side into the places from number `first` on."""
        for index, picture in enumerate(drawn, first):
            row, column = divmod(index, self._columns)
            place = GAP + column * (TILE + GAP), GAP + row * (TILE + CAPTION + GAP)
            self._sheet.paste(Image.fromarray(picture), place)

    def write(self, path: Path) -> None:
        """Write the sheet to a file (PNG)."""
        encoded = BytesIO()
        self._sheet.save(encoded, "png")
        write_whole(path, encoded.getvalue())


def tiles(shown: Sequence[Shown]) -> List[np.ndarray]:
    """Return the tile of each episode; see `tile`."""
    return [tile(task, result) for task, result in shown]


def tile(task: EpisodeTask, result: EpisodeResult) -> np.ndarray:
    """Return the picture of one episode, with a red frame where it failed, shape (TILE + CAPTION, TILE, 3), uint8."""
    view, colour = _View(task, result), _colour(result)
    drawing = Image.new("RGB", (FINER * TILE, FINER * TILE), "white")
    pen = ImageDraw.Draw(drawing)
    for wall in view.pixels(task.world.outline(HEIGHT)).reshape(-1, 4).tolist():
        pen.line(wall, WALL, FINER)
    for mover in task.world.movers:
        way = np.concatenate((mover.poses, mover.poses[:1])) if mover.loop else mover.poses
        pen.line(view.pixels(way[:, :2]).ravel().tolist(), WAY, FINER)
    if len(result.trajectory):
        pen.line(view.pixels(result.trajectory[:, 1:3]).ravel().tolist(), TRACK, 3 * FINER)
        _dot(pen, view, Pose2D(*result.trajectory[-1, 1:4]), colour)
    _dot(pen, view, task.world.start, START)
    for index, goal in enumerate(task.goals):
        _dot(pen, view, goal, GOAL if index < result.goals_reached else BAD)
    image = Image.new("RGB", (TILE, TILE + CAPTION), "white")
    image.paste(drawing.resize((TILE, TILE), Image.BOX))
    pen = ImageDraw.Draw(image)
    _caption(pen, f"{result.world} #{result.seed}", TILE + 3, INK)
    words = f"{result.time:.1f} s" + (f", score {result.score:.2f}" if result.score is not None else "")
    _caption(pen, words if result.success else f"{result.outcome} {words}", TILE + 18, colour)
    pen.rectangle((0, 0, TILE - 1, TILE + CAPTION - 1), outline=colour, width=1 if result.success else 3)
    return np.asarray(image)


def failure(shown: Sequence[Shown]) -> bytes:
    """Return the drive report's picture (PNG) of an episode: map, true and estimated path, speeds and errors over time.

    `shown` holds that one episode, as it is the argument of a piece of work.
    """
    from mbf_relay.report.picture import draw  # needs matplotlib, which drives do not

    ((task, result),) = shown
    picture = BytesIO()
    draw(drive_of(task, result), picture)
    return picture.getvalue()


def drive_of(task: EpisodeTask, result: EpisodeResult) -> Drive:
    """Convert an episode to a Drive, as the drive report takes it."""
    rows = result.trajectory
    starts = (0.0,) + result.goal_times
    goals = [
        GoalRecord(goal, start, end, SUCCEEDED if index < result.goals_reached else result.outcome)
        for index, (goal, start, end) in enumerate(zip(task.goals, starts, result.goal_times + (result.time,)))
    ]
    contacts = []
    for time in result.contact_times:
        row = rows[min(int(np.searchsorted(rows[:, 0], time)), len(rows) - 1)]
        contacts.append(ContactRecord(time, float(row[1]), float(row[2]), result.message))
    return Drive(
        truth=rows[:, :4], estimate=np.column_stack((rows[:, 0], result.believed)), measured=rows[:, (0, 4, 5)],
        goals=goals, contacts=contacts, map=task.occupancy(), seed=result.seed, goals_asked=len(task.goals),
        wall_time=result.machine.get("wall"),
    )


class _View:
    """Conversion from metres to a tile's pixels, such that the whole drive is visible."""

    MARGIN = 0.6
    """Metres shown around the drive."""

    def __init__(self, task: EpisodeTask, result: EpisodeResult) -> None:
        points = [task.world.start[:2]] + [goal[:2] for goal in task.goals] + [row[1:3] for row in result.trajectory]
        low, high = np.min(points, axis=0) - self.MARGIN, np.max(points, axis=0) + self.MARGIN
        self._scale = FINER * TILE / max(high - low)
        self._left, self._top = (low + high) / 2.0 + np.array([-1.0, 1.0]) * FINER * TILE / 2.0 / self._scale

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return the coordinates of points (m), shape (..., 2), in the drawing: x right, y down, FINER per pixel."""
        return np.asarray((points - (self._left, self._top)) * (self._scale, -self._scale))


def _dot(pen: ImageDraw.ImageDraw, view: _View, pose: Pose2D, colour: Tuple[int, int, int]) -> None:
    x, y = view.pixels(np.array(pose[:2])).tolist()
    radius = 4 * FINER
    pen.ellipse((x - radius, y - radius, x + radius, y + radius), colour)


def _caption(pen: ImageDraw.ImageDraw, text: str, top: int, colour: Tuple[int, int, int]) -> None:
    known = text.encode("latin-1", "replace").decode("latin-1")  # the characters of Pillow's default font
    pen.text((6, top), known, colour, ImageFont.load_default())


def _colour(result: EpisodeResult) -> Tuple[int, int, int]:
    return GOAL if result.success else BAD
