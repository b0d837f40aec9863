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


def test_a_drive_that_ends_just_after_a_sample_is_as_calm_as_the_same_one_a_moment_before():
    # Of 252 drives to a goal, jerk came out 1.6 times as large on average for this, and of one 24 times.
    times = np.append(np.arange(0.0, 30.0, 0.1), 29.908)
    linear = 0.2 + 0.01 * np.sin(times)
    linear[-1] -= 0.01
    ended, before = (smoothness(times[:n], linear[:n], 2.0 * linear[:n], 6.0) for n in (len(times), len(times) - 1))
    assert ended.mean_jerk == pytest.approx(before.mean_jerk, rel=0.02) and before.mean_jerk < 0.01
    assert ended.mean_acceleration == pytest.approx(before.mean_acceleration, rel=0.02)
    assert ended.mean_angular_jerk == pytest.approx(before.mean_angular_jerk, rel=0.02)
    begun = smoothness(np.insert(times[:-1] + 0.0, 1, 0.008), np.insert(linear[:-1], 1, 0.21), 2.0 * np.insert(
        linear[:-1], 1, 0.21), 6.0)
    assert begun.mean_jerk == pytest.approx(before.mean_jerk, rel=0.02)


def test_weaving_is_counted_per_metre():
    times = np.arange(0.0, 4.0, 0.1)
    angular = np.where((times / 0.5).astype(int) % 2 == 0, 0.5, -0.5)
    assert smoothness(times, np.full(len(times), 0.5), angular, 2.0).turn_changes_per_metre == 3.5


def test_standing_and_too_short():
    assert smoothness(np.arange(3.0), np.zeros(3), np.zeros(3), 0.0).standing_share == 1.0
    assert smoothness(np.arange(2.0), np.zeros(2), np.zeros(2), 0.0) == Smoothness()
