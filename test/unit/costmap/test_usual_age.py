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


@pytest.mark.parametrize("periods, limit", [
    ([0.2] * 4 + [0.8] + [0.2] * 4, 0.5), ([0.4, 0.2] * 2, 0.6),
    ([0.2] * 9 + [-50.0], 1.0),  # its own clock began anew
])
def test_scans_that_get_lost_now_and_then_do_not_keep_a_robot_driving_on_old_ones(periods, limit):
    usual = UsualAge()
    for period in periods:
        usual.renewed(0.3, period)
    assert usual.limit(1.0) == pytest.approx(limit)


def test_a_lidar_of_forty_hertz_is_missed_no_sooner_than_need_be():
    assert used_to(*[0.025] * 9, period=0.025).limit(1.0) == pytest.approx(0.4)


def lidar_costmap(**layer):
    return build_costmap("local_costmap", {
        "rolling_window": True, "width": 2.0, "height": 2.0, "plugins": [{"name": "o", "type": "ObstacleLayer"}],
        "o": {"observation_sources": "scan", "scan": {"data_type": "LaserScan", "marking": True}, **layer}})


def scan_at(costmap, stamp, latency=0.0, frame=""):
    costmap.observe("scan", Observation((0.0, 0.0), np.array([[1.0, 0.0]]), None, stamp, frame), stamp + latency)
    costmap.update(stamp + latency, IDENTITY)


def test_a_lidar_that_stops_is_missed_with_its_second_scan():
    costmap = lidar_costmap()
    for count in range(1, 10):
        scan_at(costmap, 0.2 * count)
    assert costmap.stale_reason(1.8 + 0.39) is None
    assert costmap.stale_reason(1.8 + 0.41).endswith("at most 0.40 s is allowed")


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


def two_lidars(costmap, until):
    """Two lidars on one topic, told apart by their frames, one shortly after the other."""
    for count in range(1, until + 1):
        scan_at(costmap, 0.2 * count, frame="front")
        scan_at(costmap, 0.2 * count + 0.05, frame="rear")


def test_a_robot_does_not_drive_on_when_the_front_one_of_its_two_lidars_dies():
    costmap = lidar_costmap()
    two_lidars(costmap, 9)
    assert costmap.stale_reason(1.9) is None
    for count in range(10, 13):
        scan_at(costmap, 0.2 * count + 0.05, frame="rear")
    assert costmap.stale_reason(2.5) == (
        "local_costmap: lidar source 'scan' on topic 'scan', the one of 2 in frame 'front', sent nothing for 0.70 s; "
        "at most 0.40 s is allowed; if it was taken away for good, start this node again")
    scan_at(costmap, 2.6, frame="front")
    assert costmap.stale_reason(2.6) is None


def test_a_robot_goes_on_when_its_lidar_was_started_again_with_another_frame():
    costmap = lidar_costmap()
    for count in range(1, 20):
        scan_at(costmap, 0.2 * count, frame="base_scan" if count < 10 else "laser")
    assert costmap.stale_reason(4.0) is None


def test_two_lidars_that_send_at_once_hide_nothing_from_each_other():
    """Only the newest scan of a topic counted, so of two that came between two updates the first was never shown."""
    costmap = lidar_costmap()
    two_lidars(costmap, 2)
    for frame, y in (("front", 0.5), ("rear", -0.5)):
        costmap.observe("scan", Observation((0.0, 0.0), np.array([[0.5, y]]), None, 0.6, frame), 0.6)
    costmap.update(0.6, IDENTITY)
    snapshot = costmap.snapshot()
    columns, rows = snapshot.grid.cells_at(np.array([[0.5, 0.5], [0.5, -0.5]])).T
    assert (snapshot.costs[rows, columns] == 254).all()
