"""When a sensor has fallen silent: soon enough to stand, and not where the machine or the sensor is merely slow."""

import numpy as np
import pytest

from mbf_relay.costmap.factory import build_costmap
from mbf_relay.costmap.observation import Observation
from mbf_relay.costmap.usual_age import UsualAge
from mbf_relay.geometry import IDENTITY


def used_to(*ages, period=0.2):
    usual = UsualAge()
    for age in ages:
        usual.renewed(age, period)
    return usual


@pytest.mark.parametrize("ages, limit", [
    ([0.2] * 9, 0.4),  # the burger's lidar, at once where it is needed
    ([0.4] * 9, 0.6),  # stamped when its turn began
    ([0.3, 0.5, 0.3], 0.7),  # on a busy machine
    ([7.0] + [0.2] * 9, 0.4),  # a pause that is over
    ([2.0] * 9, 1.0),  # nobody waits longer than he says
    ([0.2, 0.2], 1.0), ([], 1.0),  # nothing is usual yet
    ([0.2] * 9 + [-50.0], 1.0),  # nor on a clock that began anew
])
def test_a_robot_waits_for_one_scan_more_than_usual(ages, limit):
    assert used_to(*ages).limit(1.0) == pytest.approx(limit)


def test_a_lidar_of_forty_hertz_is_missed_no_sooner_than_need_be():
    assert used_to(*[0.025] * 9, period=0.025).limit(1.0) == pytest.approx(0.4)


def lidar_costmap(**layer):
    return build_costmap("local_costmap", {
        "rolling_window": True, "width": 2.0, "height": 2.0, "plugins": [{"name": "o", "type": "ObstacleLayer"}],
        "o": {"observation_sources": "scan", "scan": {"data_type": "LaserScan", "marking": True}, **layer}})


def scan_at(costmap, stamp, latency=0.0):
    costmap.observe("scan", Observation((0.0, 0.0), np.array([[1.0, 0.0]]), None, stamp), stamp + latency)
    costmap.update(stamp + latency, IDENTITY)


def test_a_lidar_that_stops_is_missed_with_its_second_scan():
    costmap = lidar_costmap()
    for count in range(1, 10):
        scan_at(costmap, 0.2 * count)
    assert costmap.stale_reason(1.8 + 0.39) is None
    assert "lidar source 'scan'" in costmap.stale_reason(1.8 + 0.41)


def test_a_machine_whose_scans_come_late_does_not_stop_the_robot_between_two_of_them():
    costmap = lidar_costmap()
    for count in range(1, 10):
        scan_at(costmap, 0.2 * count, latency=0.25)
        assert costmap.stale_reason(0.2 * count + 0.449) is None


def test_a_robot_whose_user_says_how_long_waits_so_long():
    costmap = lidar_costmap(scan={"data_type": "LaserScan", "expected_update_rate": 0.8})
    for count in range(1, 10):
        scan_at(costmap, 0.2 * count)
    assert costmap.stale_reason(1.8 + 0.79) is None and costmap.stale_reason(1.8 + 0.81)
