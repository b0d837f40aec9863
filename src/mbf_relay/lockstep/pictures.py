"""Pictures of episodes: a sheet with all of them, and one of each failure."""

from __future__ import annotations

import math
from io import BytesIO
from pathlib import Path
from typing import List, Sequence, Tuple

import cv2
import numpy as np

from mbf_relay.geometry import Pose2D
from mbf_relay.lockstep.result import EpisodeResult
from mbf_relay.lockstep.tasks import EpisodeTask
from mbf_relay.report.drive import SUCCEEDED, ContactRecord, Drive, GoalRecord
from mbf_relay.whole_files import write_whole

TILE, CAPTION, GAP = 220, 34, 6
"""Pixels: side of a tile's picture, height of the text under it, space between tiles."""

WALL, TRACK, START, GOAL, BAD, INK = (
    (60, 60, 60),
    (200, 110, 30),
    (200, 110, 30),
    (62, 138, 43),
    (42, 42, 201),
    (40, 40, 40),
)
HEIGHT = 0.1
"""Height (m) above the ground at which the world is shown."""

Shown = Tuple[EpisodeTask, EpisodeResult]


def contact_sheet(drawn: Sequence[np.ndarray], path: Path) -> None:
    """Write one picture of all tiles, a landscape sheet.

    Args:
        drawn: Tiles, see `tile`.
        path: File to write (PNG).
    """
    if not drawn:
        return
    columns = max(1, math.ceil(math.sqrt(1.6 * len(drawn))))
    rows = math.ceil(len(drawn) / columns)
    width, height = TILE + GAP, TILE + CAPTION + GAP
    sheet = np.full((rows * height + GAP, columns * width + GAP, 3), 255, dtype=np.uint8)
    for index, picture in enumerate(drawn):
        row, column = divmod(index, columns)
        top, left = GAP + row * height, GAP + column * width
        sheet[top:top + TILE + CAPTION, left:left + TILE] = picture
    write_whole(path, _encoded(sheet))


def tiles(shown: Sequence[Shown]) -> List[np.ndarray]:
    """Return the picture of each of some episodes."""
    return [tile(task, result) for task, result in shown]


def tile(task: EpisodeTask, result: EpisodeResult) -> np.ndarray:
    """Return the picture of one episode, framed red where it failed, shape (TILE + CAPTION, TILE, 3), blue first."""
    image = np.full((TILE + CAPTION, TILE, 3), 255, dtype=np.uint8)
    view = _View(task, result)
    cv2.polylines(image, list(view.pixels(task.world.outline(HEIGHT))), False, WALL, 1, cv2.LINE_AA, _View.SHIFT)
    for mover in task.world.movers:
        cv2.polylines(
            image, [view.pixels(mover.poses[:, :2])], mover.loop, (170, 170, 220), 1, cv2.LINE_AA, _View.SHIFT
        )
    track = result.trajectory
    if len(track):
        cv2.polylines(image, [view.pixels(track[:, 1:3])], False, TRACK, 2, cv2.LINE_AA, _View.SHIFT)
        _dot(image, view, Pose2D(*track[-1, 1:4]), _colour(result))
    _dot(image, view, task.world.start, START)
    for index, goal in enumerate(task.goals):
        _dot(image, view, goal, GOAL if index < result.goals_reached else BAD)
    image[TILE:] = 255
    _caption(image, f"{result.world} #{result.seed}", TILE + 13, INK)
    words = f"{result.time:.1f} s" + (f", score {result.score:.2f}" if result.score is not None else "")
    _caption(image, words if result.success else f"{result.outcome} {words}", TILE + 28, _colour(result))
    cv2.rectangle(image, (0, 0), (TILE - 1, TILE + CAPTION - 1), _colour(result), 1 if result.success else 3)
    return image


def failure(shown: Sequence[Shown]) -> bytes:
    """Return the report's picture (PNG) of one episode: map, way, belief, speeds and errors over time."""
    from mbf_relay.report.picture import draw  # needs matplotlib, which drives do not

    ((task, result),) = shown
    picture = BytesIO()
    draw(drive_of(task, result), picture)
    return picture.getvalue()


def drive_of(task: EpisodeTask, result: EpisodeResult) -> Drive:
    """Return an episode as the report's record of a drive."""
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
    """Takes metres to pixels so that the whole drive fits into a tile."""

    SHIFT = 4
    MARGIN = 0.6

    def __init__(self, task: EpisodeTask, result: EpisodeResult) -> None:
        points = [task.world.start[:2]] + [goal[:2] for goal in task.goals] + [row[1:3] for row in result.trajectory]
        low, high = np.min(points, axis=0) - self.MARGIN, np.max(points, axis=0) + self.MARGIN
        self._scale = TILE / max(high - low)
        self._left, self._top = (low + high) / 2.0 + np.array([-1.0, 1.0]) * TILE / 2.0 / self._scale

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Return points (m), shape (..., 2), as OpenCV takes them, with SHIFT bits of fraction."""
        flipped = (points - (self._left, self._top)) * (self._scale, -self._scale)
        fixed_point: np.ndarray = np.round(flipped * (1 << self.SHIFT)).astype(np.int32)
        return fixed_point


def _dot(image: np.ndarray, view: _View, pose: Pose2D, colour: Tuple[int, int, int]) -> None:
    center = view.pixels(np.array(pose[:2]))
    cv2.circle(image, tuple(int(value) for value in center), 4 << _View.SHIFT, colour, -1, cv2.LINE_AA, _View.SHIFT)


def _caption(image: np.ndarray, text: str, baseline: int, colour: Tuple[int, int, int]) -> None:
    cv2.putText(image, text, (6, baseline), cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, 1, cv2.LINE_AA)


def _colour(result: EpisodeResult) -> Tuple[int, int, int]:
    return GOAL if result.success else BAD


def _encoded(image: np.ndarray) -> bytes:
    encoded, data = cv2.imencode(".png", image)
    if not encoded:
        raise ValueError(f"a picture of shape {image.shape} could not be encoded")
    return bytes(data)
