"""What amcl's diagnostics say of its scans."""

import pytest

pytest.importorskip("tf2_ros")

from mbf_relay.ros.amcl.health import ScanWatch
from mbf_relay.ros.common import diagnostics


def watch(*stamps):
    made = ScanWatch()
    for stamp in stamps:
        made.saw(stamp)
    return made


@pytest.mark.parametrize(
    "stamps, now, has_map, match, waiting, level, words",
    [
        ((0.0, 0.2, 0.4), 0.5, True, 0.97, False, diagnostics.OK, "scans are used"),
        ((0.0, 0.2, 0.4), 0.5, True, None, False, diagnostics.OK, "scans are used"),
        ((0.0, 0.2, 0.4), 0.5, True, 0.3, False, diagnostics.WARN, "only 30 % of the scan"),
        ((0.0, 0.2, 0.4), 3.4, True, 0.97, False, diagnostics.ERROR, "no scan for 3.0 s: none comes"),
        ((0.0, 0.2, 0.4), 3.4, True, 0.97, True, diagnostics.ERROR, "the transform at its time is missing"),
        ((0.0, 5.0, 10.0), 14.0, True, 0.97, False, diagnostics.OK, "scans are used"),
        ((), 1.0, True, None, False, diagnostics.ERROR, "no scan yet"),
        ((0.0, 0.2), 0.3, False, None, False, diagnostics.ERROR, "no map yet"),
    ],
)
def test_levels_mean_something(stamps, now, has_map, match, waiting, level, words):
    told = watch(*stamps).report(now, has_map, match, waiting)
    assert told[0] == level and words in told[1]


def test_values_are_told_whatever_the_level():
    _, _, values = watch(0.0, 0.2, 0.4).report(0.5, True, 0.914, False)
    assert values["share of the scan on the map's walls [%]"] == "91"
    assert values["scans [Hz]"] == "5.0" and values["age of the last scan [s]"] == "0.10"
