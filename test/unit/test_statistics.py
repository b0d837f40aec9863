"""Intervals against values worked out elsewhere, and against what they promise."""

import math

import numpy as np
import pytest

from mbf_relay import statistics


def test_share_as_in_wilson():
    # Newcombe (1998), table I: 81 of 263 gives 0.2553 to 0.3662, 0 of 20 gives 0 to 0.1611.
    assert statistics.share(81, 263) == pytest.approx((0.30798, 0.2553, 0.3662), abs=5e-5)
    assert statistics.share(0, 20) == pytest.approx((0.0, 0.0, 0.1611), abs=5e-5)
    assert statistics.share(29, 29).high == 1.0


def test_share_of_groups_of_one_is_wilsons():
    groups = {str(i): [float(i < 81)] for i in range(263)}
    assert statistics.grouped_share(groups) == pytest.approx(statistics.share(81, 263))


def test_groups_that_are_alike_within_count_once_each_and_unlike_ones_in_full():
    alike = statistics.grouped_share({str(i): [float(i % 2)] * 5 for i in range(20)})
    unlike = statistics.grouped_share({str(i): [0.0, 1.0, 0.0, 1.0] for i in range(20)})
    assert alike.high - alike.low == pytest.approx(share_width(10, 20), rel=0.06)
    assert unlike.high - unlike.low == pytest.approx(share_width(40, 80))
    certain = statistics.grouped_share({str(i): [1.0] * 5 for i in range(20)})
    assert certain == pytest.approx(statistics.share(20, 20))
    one_world = statistics.grouped_share({"a": [1.0] * 9})
    assert one_world == pytest.approx(statistics.share(9, 9)) and one_world.low < 1.0


def share_width(successes, trials):
    estimate = statistics.share(successes, trials)
    return estimate.high - estimate.low


def test_nothing_measured_has_no_value():
    assert math.isnan(statistics.share(0, 0).value)
    assert math.isnan(statistics.mean({"a": []}).value)


def test_mean_interval_holds_the_truth_about_as_often_as_it_says():
    rng = np.random.default_rng(3)
    held = 0
    for _ in range(200):
        groups = {str(i): rng.normal(1.0, 0.5, 3) + rng.normal(0.0, 0.5) for i in range(30)}
        estimate = statistics.mean(groups)
        held += estimate.low <= 1.0 <= estimate.high
    assert 178 <= held <= 199


@pytest.mark.parametrize("worlds", [2, 3, 5, 10])
def test_intervals_of_few_worlds_hold_the_truth_as_often_as_those_of_many(worlds):
    # A percentile bootstrap of 2, 3, 5, 10 groups holds it in 50, 75, 84, 91 of 100; of 5 equal pairs of planners, one
    # would seem to differ.
    rng = np.random.default_rng(worlds)
    held, draws = {"mean": 0, "share": 0}, 600
    for _ in range(draws):
        means = {str(i): rng.normal(1.0, 0.5, 3) + rng.normal(0.0, 0.5) for i in range(worlds)}
        shares = {str(i): (rng.random(10) < rng.beta(1.0, 0.5)).astype(float) for i in range(worlds)}
        for name, truth, made in (("mean", 1.0, statistics.mean(means)),
                                  ("share", 2.0 / 3.0, statistics.grouped_share(shares))):
            held[name] += made.low <= truth <= made.high
    assert held["mean"] >= 0.92 * draws, held  # of 600 with 95 %, as few as that once in a thousand
    assert held["share"] >= 0.92 * draws, held


def test_mean_interval_is_students():
    # Student (1908), section IX: the gain of hours of sleep by the second drug over the first, of ten patients.
    gains = [1.2, 2.4, 1.3, 1.3, 0.0, 1.0, 1.8, 0.8, 4.6, 1.4]
    made = statistics.mean({str(i): [gain] for i, gain in enumerate(gains)})
    assert made == pytest.approx((1.58, 0.7001, 2.4599), abs=5e-5)


def test_mean_interval_is_wider_for_groups_that_agree_within():
    values = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0] * 4
    alone = statistics.mean({str(i): [value] for i, value in enumerate(values)})
    grouped = statistics.mean({str(i): [float(i % 2)] * 3 for i in range(8)})
    assert alone.value == grouped.value
    assert grouped.high - grouped.low > alone.high - alone.low


def test_equal_samples_equal_intervals():
    groups = {"b": [1.0, 2.0], "a": [3.0]}
    assert statistics.mean(groups) == statistics.mean(dict(reversed(list(groups.items()))))


def test_one_group_is_drawn_by_sample_and_one_sample_has_no_interval():
    assert statistics.mean({"a": [1.0, 2.0, 3.0]}).low < 2.0
    assert str(statistics.mean({"a": [1.0]})) == "1.000 (one sample, no interval)"


def test_sign_test():
    assert statistics.sign_test(pairs(0, 0)) == 1.0
    assert statistics.sign_test(pairs(5, 0)) == pytest.approx(2 / 32)
    assert statistics.sign_test(pairs(3, 3)) == 1.0
    assert statistics.sign_test(pairs(8, 2)) == statistics.sign_test(pairs(2, 8)) == pytest.approx(0.109375)


def pairs(gained, lost):
    return {str(i): [1 if i < gained else -1] for i in range(gained + lost)}


def test_many_seeds_of_one_world_are_no_more_evidence_than_the_world():
    assert statistics.sign_test({"a": [1] * 20}) == 1.0
    assert statistics.sign_test({"a": [1] * 20, "b": [1, 0, 1], "c": [0]}) == 0.5
    assert statistics.permutation_test({"a": [0.3] * 20}) == 1.0


def test_permutations_of_all_signs_and_of_drawn_ones_agree():
    rng = np.random.default_rng(5)
    few = {str(i): [value] for i, value in enumerate(rng.normal(0.6, 1.0, 12))}
    assert statistics.permutation_test(few) == pytest.approx(0.0435, abs=0.03)
    many = {str(i): [value] for i, value in enumerate(rng.normal(1.0, 1.0, 40))}
    assert statistics.permutation_test(many) < 0.001
    assert statistics.permutation_test({"a": [0.0], "b": [0.0]}) == 1.0


def test_fewer_groups_than_the_least_never_give_a_rare_chance():
    for chance in (0.05, 0.025, 0.01):
        least = statistics.least_groups(chance)
        for count in (least - 1, least):
            alike = {str(index): [1] for index in range(count)}
            assert (statistics.sign_test(alike) < chance) == (count == least)
            assert (statistics.permutation_test(alike) < chance) == (count == least)


def test_holms_correction():
    # Holm (1979): the smallest times the number of tests, the next times one less, never falling.
    assert statistics.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert statistics.holm([0.9, 0.8]) == [1.0, 1.0]
    assert statistics.holm([]) == []
