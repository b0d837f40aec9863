"""Distances of cells: exact, whatever lies where."""

import numpy as np
import pytest

from mbf_relay.distances import around, distances_to_zeros


@pytest.mark.parametrize("share", [0.003, 0.03, 0.3])
def test_every_cell_knows_its_nearest_obstacle_to_the_last_bit(share):
    rng = np.random.default_rng(7)
    for _ in range(20):
        free = rng.random(rng.integers(1, 40, 2)) >= share
        free.flat[rng.integers(free.size)] = False
        rows, columns = np.indices(free.shape)
        squared = np.min([(rows - y) ** 2 + (columns - x) ** 2 for y, x in np.argwhere(~free)], axis=0)
        expected = np.sqrt(squared.astype(np.float32))
        np.testing.assert_array_equal(distances_to_zeros(free), expected)
        for farthest in (0.0, 2.5, 7.0, 30.0):  # the last one beyond what is looked at cell by cell
            found = distances_to_zeros(free, farthest)
            np.testing.assert_array_equal(found[expected <= farthest], expected[expected <= farthest])
            assert (found[expected > farthest] > farthest).all(), "what is far is not told to be near"


def test_what_is_farther_away_than_is_looked_for_is_not_told_to_be_near():
    """Whole rows of it, in which nothing is written but that: obstacles would be told of where memory holds zeros."""
    free = np.ones((200, 40), np.uint8)
    free[3, 7] = 0
    for _ in range(5):
        np.zeros(free.shape, np.float32)  # what is given back is often given out again
        found = distances_to_zeros(free, 30.0)
        assert (found[40:] > 30.0).all() and found[3, 7] == 0.0


def test_without_an_obstacle_all_is_infinitely_far():
    assert np.isinf(distances_to_zeros(np.ones((3, 4), np.uint8))).all()


@pytest.mark.parametrize("outside", [False, True])
def test_neighbours_are_eight_and_none_wraps_round_the_border(outside):
    marked = np.zeros((4, 5), bool)
    marked[0, 0] = marked[3, 2] = True
    expected = np.zeros((4, 5), bool)
    expected[:2, :2] = expected[2:, 1:4] = True
    np.testing.assert_array_equal(around(marked, outside), expected)
