"""Places where the robot was refused on the spot: for a while they are worth a way round."""

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
"""Robot's widths that a way round may be longer for a place that was refused once; twice that for one refused twice."""
DOUBLINGS = 5
"""Refusals of one place after which its toll rises no more."""
HALF_LIFE = 30.0
"""Seconds in which a toll falls to its half: what stood there may be gone."""
FORGOTTEN = 1.0
"""Robot's widths below which a toll is none."""

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
    """Return a path round places where it is longer by no more than their toll; otherwise the one there is.

    Args:
        tolls: In the costmap's frame. A place that the robot's side would reach from start or goal costs none.
        costmap: The snapshot as it is.
        start, goal: Of the plan.
        plan: Plans on a snapshot.

    Raises:
        PlanningError: That of the plan on the snapshot as it is, or CANCELED.
    """
    path, reach = plan(costmap), costmap.half_width
    shut = [toll for toll in tolls if min(math.dist(toll.place, end[:2]) for end in (start, goal)) > reach]
    on_it = [toll.detour for toll in shut if _passes(path, toll.place, reach)]
    if not on_it:
        return path
    try:
        way_round = plan(_closed(costmap, [toll.place for toll in shut], costmap.width))
    except PlanningError as error:
        if error.outcome is PlanOutcome.CANCELED:
            raise
        return path
    return way_round if way_round.length <= path.length + sum(on_it) else path


def _passes(path: Path, place: Point, reach: float) -> bool:
    """Return whether a path comes within `reach` (m) of a place."""
    return bool((np.hypot(*(path.poses[:, :2] - place).T) <= reach).any())


def _closed(costmap: CostGrid, places: Sequence[Point], reach: float) -> CostGrid:
    """Return a snapshot in which nothing within `reach` (m) of some places may be passed."""
    costs, grid = costmap.costs.copy(), costmap.grid
    cells = math.ceil(reach / grid.resolution)
    offsets = np.arange(-cells, cells + 1)
    disc = np.argwhere(np.hypot(*np.meshgrid(offsets, offsets)) * grid.resolution <= reach) - cells
    for x, y in places:
        around = disc + grid.cell_at(x, y)
        around = around[grid.contains_cells(around)]
        columns, rows = around[:, 0], around[:, 1]
        costs[rows, columns] = np.where(costs[rows, columns] == LETHAL, LETHAL, INSCRIBED)
    return costmap.with_costs(costs)
