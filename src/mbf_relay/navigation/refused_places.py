"""Places where the controller found no way through: for a while, plans that lead there count as longer."""

from __future__ import annotations

import math
from typing import Callable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from mbf_relay.costmap.cost_grid import INSCRIBED, LETHAL, CostGrid
from mbf_relay.geometry import Pose2D
from mbf_relay.outcomes import PlanningError, PlanOutcome
from mbf_relay.planning.passage import checker_on, touching_cells
from mbf_relay.planning.path import Path

TOLL = 10.0
"""Detour (robot's widths) that is worth taking round a place refused once; each further refusal doubles it."""
DOUBLINGS = 5
"""Refusals of one place after which its toll rises no more."""
HALF_LIFE = 30.0
"""Seconds in which a toll falls by half: what stood there may be gone."""
FORGOTTEN = 1.0
"""Detour (robot's widths) below which a toll is dropped."""
MOST_PLANS = 5
"""Plans made for one path at most: where no way is good many places are refused, and on a large map each plan is slow.
"""

Point = Tuple[float, float]


class Toll(NamedTuple):
    """A place, in the planners' frame, and what going round it may cost (m)."""

    place: Point
    detour: float


class RefusedPlace(NamedTuple):
    """Where the robot did not fit through, how often, and when last (s)."""

    place: Point
    times: int
    last: float


class RefusedPlaces:
    """Remembers where the robot was refused, for one goal.

    A gap hardly wider than the robot looks too narrow from its mouth, and wide enough from a metre away, from where
    less of it is seen. A planner that remembers nothing sends the robot to and fro between two of them for ever.
    """

    def __init__(self) -> None:
        self._places: List[RefusedPlace] = []

    def refuse(self, now: float, place: Point, width: float) -> None:
        """Remember a place at `now` (s); what lies within the robot's `width` (m) of it is the same place."""
        here = next((known for known in self._places if math.dist(known.place, place) < width), None)
        if here is not None:
            self._places.remove(here)
        self._places.append(RefusedPlace(place, here.times + 1 if here is not None else 1, now))

    def tolls(self, now: float, width: float) -> Tuple[Toll, ...]:
        """Return what is to be gone round at `now` (s) by a robot of some `width` (m)."""
        tolls = (
            Toll(known.place, TOLL * width * 2.0 ** (min(known.times, DOUBLINGS) - 1 - (now - known.last) / HALF_LIFE))
            for known in self._places if known.last <= now
        )
        return tuple(toll for toll in tolls if toll.detour > FORGOTTEN * width)


def refusing_place(costmap: CostGrid, poses: np.ndarray) -> Optional[Point]:
    """Return the first place along a path, poses (N, 3) from the robot on, at which the robot does not fit; or None."""
    if len(poses) < 2:
        return None
    found: List[Point] = [(x, y) for x, y, _ in poses[costmap.blocks(poses)][:1].tolist()]
    narrow = touching_cells(checker_on(costmap), Path(poses, costmap.frame))
    found += [costmap.grid.center_of(*cell) for cell in narrow[:1].tolist()]
    if not found:
        return None
    return min(found, key=lambda point: math.dist(point, poses[0, :2]))


def plan_round(
    tolls: Sequence[Toll], costmap: CostGrid, start: Pose2D, goal: Pose2D, plan: Callable[[CostGrid], Path]
) -> Path:
    """Return a path whose length and tolls together are the least of those looked at.

    The first path is planned on the snapshot as it is. Then the places it passes are closed and another one is planned,
    and so on, until a path passes none or none is found. Only places on a path are closed: all at once might wall the
    robot in.

    Args:
        tolls: In the costmap's frame. A place within half the robot's width of start or goal has no toll.
        costmap: The snapshot as it is.
        start, goal: Of the plan.
        plan: Plans on a snapshot.

    Raises:
        PlanningError: That of the plan on the snapshot as it is, or CANCELED.
    """
    path, reach, ends = plan(costmap), costmap.half_width, (start[:2], goal[:2])
    paid = [toll for toll in tolls if min(math.dist(toll.place, end) for end in ends) > reach]
    least, best = math.inf, path
    closed: List[Point] = []
    for left in reversed(range(MOST_PLANS)):
        passed = [toll for toll in paid if _passes(path, toll.place, reach)]
        cost = path.length + sum(toll.detour for toll in passed)
        if cost <= least:
            least, best = cost, path
        to_close = [toll.place for toll in passed if toll.place not in closed]
        if not to_close or path.length >= least or left == 0:
            break
        closed += to_close
        try:
            path = plan(_closed(costmap, closed, ends))
        except PlanningError as error:
            if error.outcome is PlanOutcome.CANCELED:
                raise
            break
    return best


def _passes(path: Path, place: Point, reach: float) -> bool:
    """Return whether a path comes within `reach` (m) of a place."""
    return bool((np.hypot(*(path.poses[:, :2] - place).T) <= reach).any())


def _closed(costmap: CostGrid, places: Sequence[Point], ends: Sequence[Point]) -> CostGrid:
    """Return a snapshot with discs as wide as two robots closed round some places.

    Cells nearer to an end of the path stay open, or a robot right before a place could not leave it.
    """
    costs, grid, reach = costmap.costs.copy(), costmap.grid, costmap.width
    cells = math.ceil(reach / grid.resolution)
    offsets = np.arange(-cells, cells + 1)
    disc = np.stack(np.meshgrid(offsets, offsets), axis=-1).reshape(-1, 2)
    for place in places:
        around = disc + grid.cell_at(*place)
        around = around[grid.contains_cells(around)]
        centers = grid.centers_of(around)
        away = np.hypot(*(centers - place).T)
        shut = away <= reach
        for end in ends:
            shut &= away < np.hypot(*(centers - end).T)
        columns, rows = around[shut].T
        costs[rows, columns] = np.where(costs[rows, columns] == LETHAL, LETHAL, INSCRIBED)
    return costmap.with_costs(costs)
