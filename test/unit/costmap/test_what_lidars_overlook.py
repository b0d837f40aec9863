"""A lidar that looks over or under what counts, and what is seen to be gone."""

import math
from dataclasses import replace

import numpy as np
import pytest
from test_layers import cost_at, with_obstacles

from mbf_relay.costmap.cost_grid import FREE_SPACE, LETHAL
from mbf_relay.costmap.observation import Observation
from mbf_relay.costmap.observation_source import SourceParameters
from mbf_relay.geometry import IDENTITY, Pose2D


def scan_at(height, pitch=0.0, ranges=1.0):
    """Return what a lidar at a height sees of a round room, pitched forward by radians."""
    bearings = np.radians(np.arange(0.0, 360.0, 5.0))
    points = np.column_stack((ranges * np.cos(bearings), ranges * np.sin(bearings), np.zeros(len(bearings))))
    points[:, 2] = height - math.tan(pitch) * points[:, 0]
    return Observation((0.0, 0.0, height), points, None, 1.0)


def part(seen, which):
    return replace(seen, points=seen.points[which])


@pytest.mark.parametrize("height, why", [
    (0.36, "level at 0.36 m, and what lies between 0.25 and 0.3 m"), (0.1, "level at 0.10 m"), (0.28, None),
])
@pytest.mark.parametrize("seen", [{}, {"pitch": 0.015, "ranges": 1.8}])
def test_a_robot_whose_lidar_looks_over_or_under_what_counts_does_not_drive_blind(height, why, seen):
    costmap = with_obstacles({"min_obstacle_height": 0.25, "max_obstacle_height": 0.3})
    costmap.observe("scan", scan_at(height, **seen), 1.0)
    costmap.update(1.0, IDENTITY)
    reason = costmap.stale_reason(1.0)
    assert reason is None if why is None else why in reason


@pytest.mark.parametrize("height", [0.25, 0.3])
@pytest.mark.parametrize("turn", [0.3, 0.7, 1.9])
def test_a_lidar_right_at_the_end_of_the_heights_that_count_is_no_reason_to_stand(height, turn):
    """Its height as a transform of a robot that has turned gives it, rounded to a bit less or more."""
    costmap = with_obstacles({"min_obstacle_height": 0.25, "max_obstacle_height": 0.3})
    for rounded in (height * (math.cos(turn) ** 2 + math.sin(turn) ** 2), *np.nextafter(height, (0.0, 1.0))):
        costmap.observe("scan", scan_at(float(rounded)), 1.0)
        costmap.update(1.0, IDENTITY)
        assert costmap.stale_reason(1.0) is None and cost_at(costmap, 1.0, 0.0) == LETHAL


@pytest.mark.parametrize("source, seen", [
    ({"marking": False}, scan_at(0.5)),
    ({}, scan_at(0.5, pitch=0.3)),  # on a ramp, of a robot whose transforms know it
    ({}, scan_at(0.5, pitch=0.1)), ({}, part(scan_at(0.5, pitch=0.1), slice(0, 9))),
    ({"data_type": "PointCloud2"}, scan_at(0.5)),  # of a camera, which may look higher next
    ({}, replace(scan_at(0.5), hits=np.zeros(72, bool))),  # in the open
    ({"obstacle_range": 0.5}, scan_at(0.28)),
    ({}, Observation((0.0, 0.0, 0.5), np.zeros((0, 3)), None, 1.0)),
])
def test_a_lidar_that_marks_nothing_for_another_reason_is_believed(source, seen):
    costmap = with_obstacles({"min_obstacle_height": 0.25, "max_obstacle_height": 0.3, **source})
    costmap.observe("scan", seen, 1.0)
    costmap.update(1.0, IDENTITY)
    assert costmap.stale_reason(1.0) is None


def test_a_lidar_that_sees_is_no_excuse_for_another_on_its_topic_that_looks_over_what_counts():
    """With each scan of the one that sees the robot set out, and with each of the other it stopped."""
    costmap = with_obstacles({"min_obstacle_height": 0.25, "max_obstacle_height": 0.3})
    for count in range(6):
        frame, height = ("high", 0.36) if count % 2 == 0 else ("low", 0.28)
        costmap.observe("scan", replace(scan_at(height), frame=frame), 1.0 + 0.05 * count)
        costmap.update(1.0 + 0.05 * count, IDENTITY)
    assert "level at 0.36 m" in costmap.stale_reason(1.25)
    for count in range(6, 9):  # it was raised, or looks up a ramp
        frame, height = ("high", 0.3) if count % 2 == 0 else ("low", 0.28)
        costmap.observe("scan", replace(scan_at(height), frame=frame), 1.0 + 0.05 * count)
        costmap.update(1.0 + 0.05 * count, IDENTITY)
    assert costmap.stale_reason(1.4) is None


def test_heights_in_the_wrong_order_are_named_and_not_taken():
    with pytest.raises(ValueError, match="min_obstacle_height is 0.5 m; it must not be above max_obstacle_height"):
        SourceParameters(min_obstacle_height=0.5, max_obstacle_height=0.3)


@pytest.mark.parametrize("bearing", [0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi])
def test_planners_see_that_an_obstacle_is_gone_on_whichever_side_of_the_robot(bearing):
    costmap, ahead = with_obstacles({"inf_is_valid": True}), Pose2D(0.05, 0.05, bearing)
    for distance, hit, cost in ((1.0, True, LETHAL), (2.9, False, FREE_SPACE)):
        end = ahead.transform_points(np.array([[distance, 0.0]]))
        costmap.observe("scan", Observation((0.05, 0.05), end, np.array([hit]), 1.0), 1.0)
        costmap.update(1.0, IDENTITY)
        assert cost_at(costmap, *ahead.transform_points(np.array([[1.0, 0.0]]))[0]) == cost
