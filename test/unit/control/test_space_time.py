"""The cost to go: a place is worth what can be made of it while others pass."""

import dataclasses

import numpy as np
import pytest
from kinematics import boxes, costmap_round, path_through
from paper import burger

from mbf_relay.control.foresight import MEMORY, MOST_SPREADING, NEAR, SPREADING, Foresight
from mbf_relay.control.local_path import PathTracker
from mbf_relay.control.space_time import BLOCKED, FIRST, LAYER, LAYERS, PRICE, REACH, STROKE, SpaceTimeCosts
from mbf_relay.control.space_time_kernels import look_back
from mbf_relay.control.state import ControlState
from mbf_relay.costmap.footprint_checker import FootprintChecker
from mbf_relay.geometry import STOP, Pose2D
from mbf_relay.tracking.track import Track

START = Pose2D(0.0, 0.0, 0.0)


def situation(*tracks, occupied=None, pose=START):
    """Return what moves, what stands and the path, for the burger at a pose; the path is the x axis, up to 3 m."""
    plain = costmap_round(pose, now=0.0) if occupied is None else costmap_round(pose, occupied, now=0.0)
    costmap = dataclasses.replace(plain, tracks=tracks)
    tracker = PathTracker()
    tracker.set_path(path_through((0.0, 0.0), (3.0, 0.0)))
    path = tracker.cut(ControlState(0.0, pose, STOP, costmap), 0.5, 1.5, 1.0)
    return Foresight(costmap, pose, 0.0, burger(foresight=True)), FootprintChecker(costmap), path


def cost_to_go(*tracks, occupied=None, speed=0.22):
    foresight, checker, path = situation(*tracks, occupied=occupied)
    return SpaceTimeCosts(foresight, checker, START, path, speed)


def mover(x, y, vx, vy, radius=0.1):
    return Track(1, 0.0, x, y, vx, vy, radius, 1e-4, 0.0, 1e-4)


def worth(cost, *places):
    return cost.at(np.array([(x, y, 0.0) for x, y in places]))


def test_a_place_farther_along_the_path_is_better_where_nobody_is_near():
    back, here, ahead, aside = worth(cost_to_go(mover(9.0, 9.0, 0.0, 0.0)), (-0.2, 0), (0, 0), (0.2, 0), (0.2, 0.2))
    assert ahead < here < back and ahead < aside
    assert here - ahead == pytest.approx(0.2 / 0.22, rel=0.05)


def test_a_place_from_which_there_is_no_way_out_any_more_is_bad_before_anybody_is_there():
    """One at twice the robot's speed is let past from where two steps aside are left, not from the middle."""
    cost = cost_to_go(mover(1.35, 0.0, -0.44, 0.0))
    middle, aside = worth(cost, (0.0, 0.0), (0.0, 0.25))
    assert middle > aside + 2.0


def test_a_lane_is_crossed_where_there_is_time_and_no_place_to_stop_in_where_there_is_none():
    far, near = cost_to_go(mover(0.5, 1.8, 0.0, -0.2)), cost_to_go(mover(0.5, 0.75, 0.0, -0.3))
    assert np.diff(worth(far, (0.1, 0.0), (0.3, 0.0))) < -0.5
    assert np.diff(worth(near, (0.1, 0.0), (0.3, 0.0))) > -0.1
    assert np.diff(worth(near, (0.1, 0.0), (0.42, 0.0))) > 0.5


def test_a_place_behind_a_wall_is_no_way_out():
    """Boxed in from both sides, a place in the way of somebody fast is as bad as what will happen there."""
    comes = mover(1.9, 0.0, -0.44, 0.0)
    alley = boxes((-3.0, 0.2, 3.0, 0.3), (-3.0, -0.3, 3.0, -0.2))
    assert worth(cost_to_go(comes, occupied=alley), (0.0, 0.0)) > worth(cost_to_go(comes), (0.0, 0.0)) + 2.0


@pytest.mark.parametrize("speed", [0.01, 0.22, 0.8, 3.0])
def test_a_robot_of_any_speed_has_finite_costs_wherever_it_may_be(speed):
    cost = cost_to_go(mover(0.3, 0.1, 0.4, -1.0), speed=speed)
    assert np.isfinite(worth(cost, (0, 0), (5.0, -7.0), (-speed, speed))).all() and cost.moment > 0.0


def test_looking_back_finds_the_cheapest_of_all_ways():
    rng = np.random.default_rng(2)
    dangers, standing, end = rng.random((3, 13, 13)), rng.random((13, 13)), 5.0 * rng.random((13, 13))
    costs = np.empty((13, 13))
    look_back(dangers, standing, end, 2.0, 0.1, 0, 2, costs)
    moves = [(x, y) for x in range(-2, 3) for y in range(-2, 3) if x * x + y * y <= 4]

    def plain(row, column, layer):
        if layer == 2:
            return end[row, column]
        return min(
            0.1 * np.hypot(x, y) + 2.0 * dangers[layer + 1, row + y, column + x] + standing[row + y, column + x]
            + plain(row + y, column + x, layer + 1) for x, y in moves)

    assert costs[6, 6] == pytest.approx(plain(6, 6, 0))


class PlainCosts:
    """The cost to go, cell by cell, as SpaceTimeCosts says it is; of a path along the x axis."""

    def __init__(self, foresight, checker, pose, path, speed):
        self._checker, self._speed, self._ends = checker, speed, path.points[[0, -1], 0]
        self._goal = self._ends[0] + path.goal_arc - path.arcs[0]
        front, back = foresight.outline[:, 0].max(), foresight.outline[:, 0].min()
        width = foresight.outline[:, 1].max() - foresight.outline[:, 1].min()
        self._middle = np.array(pose.compose(Pose2D((front + back) / 2.0, 0.0, 0.0))[:2])
        self._layer = min(LAYER, width / speed)
        self._cell = speed * self._layer / REACH
        discs = width / 2.0, np.hypot((front - back) / 2.0, width / 2.0)
        self._dangers = np.empty((LAYERS, 41, 41))
        foresight.lay(*self._middle, self._cell, self._layer, np.mean(discs), self._dangers)
        self._found = {}

    def place(self, x, y):
        """Return where (m) the middle of a robot is in a cell so many from the middle one."""
        return self._middle + self._cell * np.array([x, y])

    def _stands_in_an_obstacle(self, x, y):
        costmap, place = self._checker.costmap, self.place(x, y)
        grid, (column, row) = costmap.grid, np.floor(
            (place - (costmap.grid.origin_x, costmap.grid.origin_y)) / costmap.grid.resolution)
        is_known = 0 <= column < grid.width and 0 <= row < grid.height
        return is_known and self._checker.clearances_at(place[None])[0] < costmap.half_width

    def of(self, x, y, layer=FIRST - 1):
        """Return what it costs to go on from a cell at a layer."""
        if layer == LAYERS - 1:
            along, aside = self.place(x, y)
            nearest = np.clip(along, *self._ends)
            return (max(0.0, self._goal - nearest) + np.hypot(along - nearest, aside)) / self._speed
        if (x, y, layer) not in self._found:
            self._found[x, y, layer] = min(
                STROKE * self._layer / REACH * np.hypot(dx, dy) + self._stay(x + dx, y + dy, layer + 1)
                for dx in range(-REACH, REACH + 1) for dy in range(-REACH, REACH + 1) if np.hypot(dx, dy) <= REACH)
        return self._found[x, y, layer]

    def _stay(self, x, y, layer):
        blocked = BLOCKED * self._stands_in_an_obstacle(x, y)
        danger = PRICE * self._dangers[layer, 20 + y, 20 + x]
        return self._layer * (blocked + danger) + self.of(x, y, layer)


@pytest.mark.parametrize("speed", [0.22, 0.8])
def test_a_robot_that_looks_anywhere_knows_what_the_places_round_it_are_worth(speed):
    pose = Pose2D(0.3, -0.1, 2.0)
    foresight, checker, path = situation(
        mover(0.5, 0.6, 0.05, -0.2), mover(-0.6, -0.3, 0.15, 0.05), occupied=boxes((0.45, -0.3, 0.6, 0.1)), pose=pose)
    costs = SpaceTimeCosts(foresight, checker, pose, path, speed)
    plain = PlainCosts(foresight, checker, pose, path, speed)
    assert not costs.is_clear and costs.moment == pytest.approx(FIRST * min(LAYER, 0.21 / speed))
    ahead = Pose2D(float(foresight.outline[:, 0].max() + foresight.outline[:, 0].min()) / 2.0, 0.0, 0.0)
    for x, y, a, b, theta in np.random.default_rng(1).uniform((-4, -4, 0, 0, -3), (4, 4, 1, 1, 3), (30, 5)):
        column, row = int(np.floor(x)), int(np.floor(y))
        theirs = np.array([[plain.of(column + i, row + j) for i in (0, 1)] for j in (0, 1)])
        expected = np.array([1.0 - b, b]) @ theirs @ np.array([1.0 - a, a])
        middle = Pose2D(*plain.place(column + a, row + b), theta)
        robot = middle.compose(Pose2D(-ahead.x, 0.0, 0.0))
        assert costs.at(np.array([robot]))[0] == pytest.approx(expected, abs=1e-6), (column, row)


def plain_danger(track, x, y, time, layer, radius, near):
    """Return how bad it is for a disc to be at a point while a track passes, by places it is at in the layer."""
    times = time + np.linspace(-0.5, 0.5, 201) * layer
    off = np.hypot(track.x + times * track.vx - x, track.y + times * track.vy - y).min() - radius - track.radius
    return max(0.0, min(1.0, 1.0 - off / near)) ** 2


def test_dangers_are_those_of_whoever_passes_nearest():
    tracks = (mover(0.3, 0.2, 0.4, -0.3), mover(-0.4, 0.1, 0.0, 0.2, radius=0.2))
    costmap = dataclasses.replace(costmap_round(START, now=0.0), tracks=tracks)
    foresight = Foresight(costmap, START, 0.0, burger(foresight=True))
    dangers = np.empty((4, 15, 15))
    foresight.lay(0.1, 0.05, 0.08, 0.5, 0.12, dangers)
    for layer, row, column in np.random.default_rng(1).integers((4, 15, 15), size=(200, 3)):
        time = 0.5 * (layer + 1)
        spread = SPREADING * np.sqrt(1e-4 + time * time * 1e-4)
        near = NEAR * costmap.width + min(MOST_SPREADING * costmap.width, spread)
        x, y = 0.1 + (column - 7) * 0.08, 0.05 + (row - 7) * 0.08
        expected = max(plain_danger(track, x, y, time, 0.5, 0.12, near) for track in tracks) * np.exp(-time / MEMORY)
        assert dangers[layer, row, column] == pytest.approx(expected, abs=0.01)


def test_a_way_is_exposed_as_long_as_somebody_is_near_it():
    track = mover(0.041 + 0.1 + 0.4, 0.0, -0.2, 0.0)
    costmap = dataclasses.replace(costmap_round(START, now=0.0), tracks=(track,))
    foresight = Foresight(costmap, START, 0.0, burger(foresight=True))
    still = np.zeros((1, 30, 3))
    times = 0.1 * np.arange(1, 31)
    near = NEAR * costmap.width + SPREADING * np.sqrt(1e-4 + times * times * 1e-4)
    gaps = 0.4 - 0.2 * times  # it comes straight to the front
    shares = np.clip(1.0 - np.maximum(0.0, gaps) / near, 0.0, 1.0) ** 2
    assert foresight.exposures(still, 0.1)[0] == pytest.approx((0.1 * shares * np.exp(-times / MEMORY)).sum(), rel=0.02)
    away = still - np.column_stack((0.2 * times, 0.0 * times, 0.0 * times))
    assert foresight.exposures(away, 0.1)[0] == 0.0


def test_who_comes_nowhere_near_the_robot_within_the_time_looked_ahead_leaves_it_clear():
    assert cost_to_go(mover(2.5, 0.0, 0.0, 0.3)).is_clear and cost_to_go(mover(-3.0, 0.0, -0.2, 0.0)).is_clear
    assert not cost_to_go(mover(0.5, 0.0, 0.0, 0.0)).is_clear
    assert not cost_to_go(mover(-3.0, 0.0, 0.6, 0.0)).is_clear
    assert cost_to_go(mover(-3.8, 0.0, 0.1, 0.3, radius=0.37), speed=0.8).is_clear
