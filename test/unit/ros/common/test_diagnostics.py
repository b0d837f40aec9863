"""The rates that diagnostics tell."""

import pytest

pytest.importorskip("rospy")

from mbf_relay.ros.common.diagnostics import RateMeter


def ticked(*stamps, **options):
    meter = RateMeter(**options)
    for stamp in stamps:
        meter.tick(stamp)
    return meter


def test_a_rate_is_that_of_the_last_twenty_events():
    assert ticked().rate() == 0.0 and ticked(1.0).rate() == 0.0
    slow_then_quick = [float(second) for second in range(5)] + [5.0 + 0.1 * tick for tick in range(20)]
    assert ticked(*slow_then_quick).rate() == pytest.approx(10.0)


def test_the_age_is_that_of_the_last_event():
    assert ticked().age(3.0) is None
    assert ticked(1.0, 2.0).age(3.5) == pytest.approx(1.5)


def test_a_clock_set_back_starts_anew():
    assert ticked(10.0, 11.0, 0.0, 0.5).rate() == pytest.approx(2.0)


def test_a_pause_starts_anew_where_it_ends_what_is_measured():
    assert ticked(0.0, 0.1, 50.0, 50.1, pause=1.0).rate() == pytest.approx(10.0)
    assert ticked(0.0, 0.1, 50.0, 50.1).rate() < 0.1


@pytest.mark.parametrize(
    "period, count, late", [(0.1, 20, False), (0.12, 20, False), (0.15, 20, True), (0.15, 5, False)]
)
def test_lagging_is_said_of_what_is_clearly_late_for_some_time(period, count, late):
    assert ticked(*(period * number for number in range(count))).lags(10.0) is late
