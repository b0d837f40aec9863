"""Summaries and comparisons of made-up batches."""

import math

import pytest

from mbf_relay.lockstep.result import EpisodeResult, failed
from mbf_relay.lockstep.summary import compare, summarize


def episode(world, seed=1, success=True, time=10.0, score=0.4, outcome=None):
    return EpisodeResult(
        world,
        seed,
        success,
        outcome or ("SUCCEEDED" if success else "CONTACT"),
        time=time,
        score=score if success else 0.0,
        smallest_clearance=0.1,
    )


def test_summary_counts_outcomes():
    made = summarize([episode("a"), episode("b"), episode("c", success=False), failed("d", 1, "x")])
    assert made["success"].value == 0.5
    assert made["contact"].value == made["error"].value == 0.25
    assert made["timeout"].value == 0.0
    assert made["success"].low < 0.5 < made["success"].high


def test_errors_have_no_clearance_and_failures_no_time():
    made = summarize([failed("d", 1, "x"), episode("c", success=False)])
    assert made["smallest clearance"].value == 0.1
    assert math.isnan(made["time of successes"].value)


def test_equal_batches_differ_by_nothing():
    results = [episode(str(i), time=10.0 + i) for i in range(6)]
    made = compare(results, results)
    assert (made.pairs, made.only_first, made.only_second) == (6, 0, 0)
    assert all(value.value == 0.0 for name, value in made.differences.items() if not math.isnan(value.value))
    assert made.gained == made.lost == [] and made.chance == 1.0


def test_pairing_removes_what_worlds_do_to_both():
    first = [episode(str(i), time=10.0 * (i + 1)) for i in range(8)]
    second = [episode(str(i), time=10.0 * (i + 1) - 1.0 - 0.01 * i) for i in range(8)]
    difference = compare(first, second).differences["time of successes"]
    assert difference.value == pytest.approx(-1.035)
    assert -1.07 < difference.low <= difference.high < -1.0


def test_worlds_that_changed_sides_are_named():
    first = [episode("a"), episode("b", success=False), episode("c"), episode("alone")]
    second = [episode("a"), episode("b"), episode("c", success=False)]
    made = compare(first, second)
    assert made.gained == [("b", 1)] and made.lost == [("c", 1)]
    assert (made.pairs, made.only_first, made.only_second) == (3, 1, 0)
    assert made.differences["time of successes"].value == 0.0


def test_order_of_results_does_not_matter():
    results = [episode(str(i), seed, time=10.0 + i * seed) for i in range(5) for seed in (1, 2)]
    assert summarize(results)["time of successes"] == summarize(results[::-1])["time of successes"]
