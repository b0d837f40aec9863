"""Stopwatches and pacers, on clocks that go on, stand still and jump back."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbf_relay.timing import Pacer, Stopwatch


def test_a_stopwatch_measures_from_its_start():
    watch = Stopwatch()
    assert not watch.running and watch.elapsed(7.0) == 0.0
    watch.start(3.0)
    assert watch.running and watch.elapsed(7.5) == 4.5
    watch.reset()
    assert watch.elapsed(9.0) == 0.0


def test_a_clock_that_jumps_back_starts_it_anew():
    watch = Stopwatch()
    watch.start(100.0)
    assert watch.elapsed(2.0) == 0.0 and watch.elapsed(3.5) == 1.5


def test_a_pacer_is_due_at_once_and_then_once_a_period():
    pacer = Pacer()
    due = []
    for tick in range(40):
        now = 50.0 + 0.05 * tick
        if pacer.is_due(now):
            pacer.passed(now, 0.2)
            due.append(tick)
    assert due == list(range(0, 40, 4))


@given(st.lists(st.floats(0.001, 0.5), min_size=1, max_size=60), st.floats(0.05, 0.3))
def test_it_is_due_no_more_often_than_its_rate_and_never_long_late(steps, period):
    pacer, now, passed = Pacer(), 10.0, []
    for step in steps:
        now += step
        if pacer.is_due(now):
            pacer.passed(now, period)
            passed.append(now)
        assert pacer.next <= now + period + 1e-9
    assert len(passed) <= (now - passed[0]) / period + 2


def test_jitter_does_not_add_up():
    pacer = Pacer()
    pacer.passed(10.0, 0.1)
    pacer.passed(10.103, 0.1)
    assert pacer.next == pytest.approx(10.2)
    pacer.passed(10.75, 0.1)
    assert pacer.next == pytest.approx(10.85)


def test_a_clock_that_jumps_back_makes_it_due():
    pacer = Pacer()
    pacer.passed(100.0, 0.1)
    assert pacer.is_due(3.0)
    pacer.passed(3.0, 0.1)
    assert not pacer.is_due(3.05) and pacer.next == pytest.approx(3.1)


def test_it_can_be_hastened_and_put_off():
    pacer = Pacer()
    pacer.passed(10.0, 1.0)
    pacer.hasten()
    assert pacer.is_due(10.1) and pacer.next == -math.inf
    pacer.postpone(10.1, 5.0)
    assert not pacer.is_due(15.0) and pacer.is_due(15.1)
