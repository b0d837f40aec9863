"""One way or another: which replans a drive takes when several ways lead to its goal."""

import itertools
import math

import numpy as np
import pytest
from scripted import FORWARD, GOAL, bowed_path, failing

from mbf_relay.geometry import Pose2D, Twist2D
from mbf_relay.navigation.path_hysteresis import AHEAD, SPACING, PathHysteresis, is_same_way, leads_another_way
from mbf_relay.outcomes import ControlError, ControlOutcome

WAYS = {side: bowed_path(side * 0.4) for side in (-1, 1)}


@pytest.fixture
def flipping_bench(make_bench):
    """A robot 0.2 m wide whose replans lead alternately round two sides."""
    bench = make_bench(planner_frequency=10.0)
    sides = itertools.cycle([1, 1, -1])
    bench.script.plan = lambda start, goal: WAYS[next(sides)]
    bench.script.velocity = Twist2D(0.02, 0.0, 0.0)
    return bench


def sides_taken(bench):
    return [1 if path.poses[5, 1] > 0.0 else -1 for path, _new in bench.script.paths]


def test_replans_that_flip_between_two_ways_do_not_turn_the_robot(flipping_bench):
    flipping_bench.navigator.move_base(GOAL)
    for _ in range(50):
        flipping_bench.step()
    assert len(sides_taken(flipping_bench)) > 20 and set(sides_taken(flipping_bench)) == {1}


def test_a_way_found_again_and_again_is_taken(flipping_bench):
    flipping_bench.navigator.move_base(GOAL)
    flipping_bench.step()
    flipping_bench.script.plan = lambda start, goal: WAYS[-1]
    count = len(flipping_bench.script.paths)
    for _ in range(9):
        flipping_bench.step()
    taken = sides_taken(flipping_bench)[count:]
    assert taken and set(taken) == {-1}


def test_another_way_is_taken_at_once_where_the_last_is_blocked(flipping_bench):
    flipping_bench.navigator.move_base(GOAL)
    flipping_bench.step()
    x, y = WAYS[1].poses[5, :2]
    column, row = flipping_bench.costmaps["global"].snapshot().grid.cell_at(x, y)
    flipping_bench.costmaps["global"].costs[row, column] = 254
    flipping_bench.script.plan = lambda start, goal: WAYS[-1]
    flipping_bench.step()
    flipping_bench.step()
    assert sides_taken(flipping_bench)[-1] == -1


def test_after_a_recovery_any_way_is_taken(flipping_bench):
    bench = flipping_bench
    bench.navigator.move_base(GOAL)
    bench.step()
    bench.script.plan = lambda start, goal: WAYS[-1]
    bench.script.velocity = failing(ControlError(ControlOutcome.BLOCKED_GOAL, "a chair"), 1, FORWARD)
    bench.run(lambda: bench.script.calls.get("R1"))
    bench.step()
    assert sides_taken(bench)[-1] == -1


def test_each_change_near_the_last_takes_longer():
    keeper, robot, changes = PathHysteresis(), Pose2D(0.0, 0.0, 0.0), []
    now = 0.0
    for step in range(200):
        now = 0.1 * step
        if keeper.wants(now, robot, 0.2):
            changes.append(now)
    waits = np.diff(changes)
    assert len(changes) >= 4 and (waits[1:] > 1.5 * waits[:-1]).all()
    keeper.restart()
    elsewhere = Pose2D(1.0, 0.0, 0.0)
    assert not keeper.wants(now + 1.0, elsewhere, 0.2)
    assert keeper.wants(now + 2.0, elsewhere, 0.2)
    assert not keeper.wants(now + 3.0, Pose2D(3.0, 0.0, 0.0), 0.2)
    assert not keeper.wants(1.0, Pose2D(3.0, 0.0, 0.0), 0.2), "time was set back"
    assert keeper.wants(1.6, Pose2D(3.0, 0.0, 0.0), 0.2)


def test_a_robot_off_its_path_takes_any():
    assert not leads_another_way(WAYS[1].poses, WAYS[-1].poses, Pose2D(0.5, -0.4, 0.0), 0.2)
    assert leads_another_way(WAYS[1].poses, WAYS[-1].poses, Pose2D(0.5, 0.4, 0.0), 0.2)


def test_ways_are_the_same_up_to_the_robots_width():
    assert is_same_way(bowed_path(0.4).poses, bowed_path(0.25).poses, 0.2)
    assert not is_same_way(bowed_path(0.4).poses, bowed_path(0.15).poses, 0.2)
    longer = np.vstack((bowed_path(0.4).poses, [[6.0, 0.0, 0.0]]))
    assert not is_same_way(bowed_path(0.4).poses, longer, 0.2)  # it leads on past where the other one ends
    assert is_same_way(np.zeros((1, 3)), np.array([[0.0, 0.1, 0.0]]), 0.2)


def plain_is_same_way(old, new, width):
    """Compare each point of one way's beginning with all of the other's."""
    def spread(path, length):
        arcs = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path[:, :2], axis=0).T))))
        end = min(length, arcs[-1])
        wanted = np.linspace(0.0, end, max(2, math.ceil(end / (SPACING * width)) + 1))
        return np.column_stack([np.interp(wanted, arcs, path[:, axis]) for axis in (0, 1)])

    def farthest(points, others):
        return np.hypot(*(points[:, None] - others[None]).T).min(axis=0).max()

    ahead = AHEAD * width
    return max(farthest(spread(old, ahead), spread(new, 2.0 * ahead)),
               farthest(spread(new, ahead), spread(old, 2.0 * ahead))) <= width


@pytest.mark.parametrize("seed", range(60))
def test_ways_are_the_same_where_every_point_of_one_has_one_of_the_other_near(seed):
    rng = np.random.default_rng(seed)
    steps = rng.normal((0.05, 0.0, 0.0), 0.03, (rng.integers(1, 80), 3))
    old = np.cumsum(steps, axis=0)
    new = old[:rng.integers(1, len(old) + 1)] + rng.normal(0.0, rng.choice([0.02, 0.08, 0.2]), 3)
    if seed % 4 == 0 and len(new) > 3:
        new[2] = new[1]  # a pose twice
    if seed % 4 == 1 and len(new) > 1:
        new[1] = new[0]
    assert is_same_way(old, new, 0.2) == plain_is_same_way(old, new, 0.2)


def test_a_way_that_winds_or_goes_back_a_little_is_the_same_way():
    xs = np.linspace(0.0, 6.0, 241)
    straight = np.column_stack((xs, np.zeros((241, 2))))
    winding = np.column_stack((xs, 0.12 * np.sin(12.0 * xs), np.zeros(241)))
    back = straight[np.concatenate((np.arange(48), np.arange(48, 20, -1), np.arange(20, 241)))]
    for other in (winding, back):
        for one, two in ((straight, other), (other, straight)):
            assert is_same_way(one, two, 0.2) and plain_is_same_way(one, two, 0.2)
