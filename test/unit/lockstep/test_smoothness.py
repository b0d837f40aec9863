"""Smoothness figures of drives whose figures are known."""

import numpy as np
import pytest

from mbf_relay.lockstep.smoothness import Smoothness, path_length, smoothness, turn_changes


def test_length_of_a_square():
    assert path_length(np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]])) == 4.0


def test_changes_of_side_ignore_what_is_nearly_straight():
    assert turn_changes(np.array([0.5, 0.01, 0.4, -0.01, -0.5, 0.0, -0.3, 0.6])) == 2
    assert turn_changes(np.zeros(5)) == 0


def test_constant_acceleration_has_no_jerk():
    times = np.arange(0.0, 1.0, 0.1)
    made = smoothness(times, 0.5 * times, np.full(10, 0.2), 2.0)
    assert made.mean_acceleration == pytest.approx(0.5)
    assert made.mean_jerk == pytest.approx(0.0, abs=1e-9)
    assert made.turn_changes_per_metre == 0.0
    assert made.standing_share == 0.0


def test_weaving_is_counted_per_metre():
    times = np.arange(0.0, 4.0, 0.1)
    angular = np.where((times / 0.5).astype(int) % 2 == 0, 0.5, -0.5)
    assert smoothness(times, np.full(len(times), 0.5), angular, 2.0).turn_changes_per_metre == 3.5


def test_standing_and_too_short():
    assert smoothness(np.arange(3.0), np.zeros(3), np.zeros(3), 0.0).standing_share == 1.0
    assert smoothness(np.arange(2.0), np.zeros(2), np.zeros(2), 0.0) == Smoothness()
