"""Places where the controller found no way through; for a while, plans through them get an extra cost, a toll."""

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
"""Toll of a place refused once: the longest detour (in robot widths) to take instead; doubled by each refusal."""
DOUBLINGS = 5
"""Number of refusals of one place after which its toll no longer doubles."""
HALF_LIFE = 30.0
"""Seconds in which a toll falls by half, as the obstacle may be gone."""
FORGOTTEN = 1.0
"""Toll (in robot widths) below which it is dropped."""
MOST_PLANS = 5
"""Largest number of plans made to find one path, since a plan on a large map is slow."""

Point = Tuple[float, float]


class Toll(NamedTuple):
    """A place (x, y in m, planners' frame) and the longest detour (m) to take round it."""

    place: Point
    detour: float


class RefusedPlace(NamedTuple):
    """A place (x, y in m) where the robot did not get through, how often, and the time (s) of the last refusal."""

    place: Point
    times: int
    last: float


class RefusedPlaces:
    """Remembers where the controller found no way through, for one goal.

    A gap hardly wider than the robot may look too narrow from close by, and wide enough from a metre away, where less
    of it is seen. Without this memory the robot would be sent back and forth between two such gaps for ever.
    """

    def __init__(self) -> None:
        self._places: List[RefusedPlace] = []

    def refuse(self, now: float, place: Point, width: float) -> None:
        """Count a refusal of a place at `now` (s); places less than the robot's `width` (m) apart are the same."""
        here = next((known for known in self._places if math.dist(known.place, place) < width), None)
        if here is not None:
            self._places.remove(here)
        self._places.append(RefusedPlace(place, here.times + 1 if here is not None else 1, now))

    def tolls(self, now: float, width: float) -> Tuple[Toll, ...]:
        """Return the tolls at `now` (s) for a robot of that `width` (m)."""
        tolls = (
            Toll(known.place, TOLL * width * 2.0 ** (min(known.times, DOUBLINGS) - 1 - (now - known.last) / HALF_LIFE))
            for known in self._places if known.last <= now
        )
        return tuple(toll for toll in tolls if toll.detour > FORGOTTEN * width)


def refusing_place(costmap: CostGrid, poses: np.ndarray) -> Optional[Point]:
    """Return the first place along a path where the robot does not fit, None where it fits everywhere.

    Args:
        costmap: Snapshot of a costmap.
        poses: The path from the robot on, shape (N, 3), in the costmap's frame.
    """
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
    """Return the path with the least sum of length and tolls among those tried.

    The first path is planned on the unchanged snapshot. The places with a toll that it passes are then closed and
    another path is planned, and so on, until a path passes none, none is found, or MOST_PLANS were made. Only places on
    a path are closed, since closing all of them could enclose the robot.

    Args:
        tolls: In the costmap's frame. Places within half the robot's width of start or goal are left out.
        costmap: The snapshot.
        start, goal: Poses in the costmap's frame.
        plan: Plans on a snapshot.

    Raises:
        PlanningError: As raised by the first plan, or CANCELED.
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
    """Return a snapshot in which discs with the robot's width as radius are closed (INSCRIBED) round some places.

    Cells nearer to start or goal than to the place stay open, or a robot right in front of a place could not get away.
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
