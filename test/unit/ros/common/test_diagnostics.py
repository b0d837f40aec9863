"""What diagnostics tell: rates, and that something cannot be told."""

import io
from types import SimpleNamespace

import pytest
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from ros_testing import wait_until

from mbf_relay.ros.common.diagnostics import ERROR, OK, Diagnostics, RateMeter


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


def test_a_robot_one_part_of_which_cannot_be_asked_still_tells_of_the_others(monkeypatch):
    told = []
    publisher = SimpleNamespace(publish=lambda array: told.append({status.name: status for status in array.status}))
    monkeypatch.setattr(rospy, "Publisher", lambda *_args, **_options: publisher)
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time(1))
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(rospy, "get_name", lambda: "/node")
    diagnostics = Diagnostics(period=0.001)
    diagnostics.add("map", lambda: 1 / 0)
    diagnostics.add("scans", lambda: (OK, "scans are used", {}))
    try:
        wait_until(lambda: len(told) > 2 and len(told[-1]) == 2, "more than one report")
    finally:
        diagnostics._stop.set()
        diagnostics._thread.join()
    assert told[-1]["node: scans"].level == OK
    assert told[-1]["node: map"].level == ERROR and "ZeroDivisionError" in told[-1]["node: map"].message


def test_a_node_one_of_whose_texts_no_message_can_hold_goes_on_telling_of_itself(monkeypatch):
    """The name of a file in an internal error was no UTF-8, and the node was silent from then on."""
    sent = []

    def publish(array):
        buffer = io.BytesIO()
        array.serialize(buffer)
        sent.append(DiagnosticArray().deserialize(buffer.getvalue()).status)

    monkeypatch.setattr(rospy, "Publisher", lambda *_args, **_options: SimpleNamespace(publish=publish))
    monkeypatch.setattr(rospy, "get_rostime", lambda: rospy.Time(1))
    monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
    monkeypatch.setattr(rospy, "get_name", lambda: "/node")
    diagnostics = Diagnostics(period=1e6)
    diagnostics.add("navigation", lambda: (ERROR, "no map: caf\udce9.yaml", {"file": "caf\udce9.yaml"}))
    try:
        diagnostics._publish()
    finally:
        diagnostics._stop.set()
    (status,), = sent
    assert status.message == "no map: caf\\udce9.yaml" and status.values[0].value == "caf\\udce9.yaml"
